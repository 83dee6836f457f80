// Stacks the cells of a table that is wider than the screen, so that no column is cut off on a phone.
function stack() {
  for (const table of document.querySelectorAll(".bd-article table")) {
    const heads = [...table.querySelectorAll("thead th")].map((head) => head.textContent.trim());
    for (const row of table.querySelectorAll("tbody tr"))
      [...row.cells].forEach((cell, column) => {
        if (heads[column]) cell.dataset.head = heads[column];
        cell.classList.toggle("empty", !cell.textContent.trim() && !cell.querySelector("img"));
      });
    table.classList.remove("stacked");
    table.classList.toggle("stacked", table.offsetWidth > table.parentElement.clientWidth + 1);
  }
}
addEventListener("load", stack);
addEventListener("resize", stack);

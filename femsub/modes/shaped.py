"""`Shaped`: modes whose shapes are drawn on the meshes of their parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from femsub.checks import Array, InputError, whole_numbers
from femsub.components import joined_shapes, shapes_figure, shapes_window, turned
from femsub.output import Displayed, figure_of, units_of

if TYPE_CHECKING:
    from femsub.components import Mesh
    from femsub.model import Substructure

SHAPES = 6  # default number of shapes in a figure; more would be too small


class Shaped(Displayed):
    """Modes of a model whose shapes can be drawn, beside their chart and tables."""

    shapes: Array

    def drawn_first(self) -> list[int]:
        """Indices of the modes that are drawn by default."""
        raise NotImplementedError

    def title_of(self, i: int) -> str:
        """The title of a picture of shape i."""
        raise NotImplementedError

    def plot_shapes(self, model: Substructure, meshes: Mesh | Mapping[str, Mesh], modes: Sequence[int] | None = None, *,
                    title: str = "", units: Any = "", window: bool = False) -> Any:
        """A figure of shapes on their meshes, largest displacement 1; complex shapes at the phase of that displacement.

        Parameters
        ----------
        model : Substructure
            The model that has these modes, full or reduced.
        meshes : Mesh or mapping of str to Mesh
            The mesh of the model, or the meshes of its parts by part name, all with one kind of cells. Parts without a mesh are
            not drawn.
        modes : sequence of int, optional
            Positions in the list of modes. Default: at most six modes. These are the first elastic modes, or the growing complex
            modes, or the least stable one if none grows.
        title : str
        units : str or mapping
            See `plot`.
        window : bool
            Return a `pyvista.Plotter` in place of a figure. Its `.show()` opens a window, or a view in a notebook, that can be
            turned and zoomed. Needs PyVista (`scripts/setup window`).

        Raises
        ------
        InputError
            A mode of this number does not exist; a mesh belongs to no part, or to another part; nodes and directions of DOF are
            not known.
        MissingPackageError
            `window` is asked for, but PyVista is missing.

        Examples
        --------
        >>> import femsub as fs
        >>> mesh = fs.block((1.0, 0.1, 0.1), (10, 1, 1), "hexahedron")
        >>> bar = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), supports=["left"])
        >>> figure = fs.normal_modes(bar, count=3).plot_shapes(bar, mesh, units="SI")
        >>> len(figure.axes)
        4
        """
        count = self.shapes.shape[1]
        chosen = self.drawn_first()[:SHAPES] if modes is None else whole_numbers("modes", modes).tolist()
        if not chosen or not all(-count <= i < count for i in chosen):
            raise InputError(f"modes must be positions among {count} modes, not {modes if modes is not None else chosen}")
        mesh, fields = joined_shapes(model, self.shapes[:, chosen], meshes)
        titles = [self.title_of(i) for i in chosen]
        shapes, title = turned(fields).real, title or "Modes"
        if window:
            return shapes_window(mesh, shapes, [units_of(units).said(one) for one in titles], title)
        return figure_of(lambda: shapes_figure(mesh, shapes, titles, title, {}), units_of(units))

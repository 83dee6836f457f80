// Sphinx's own scores, but that a page with the title that was asked for comes before names and text that contain it.
var Scorer = {
  objNameMatch: 11, objPartialMatch: 6, objPrio: {0: 15, 1: 5, 2: -5}, objPrioDefault: 0,
  title: 60, partialTitle: 7, term: 5, partialTerm: 2,
};

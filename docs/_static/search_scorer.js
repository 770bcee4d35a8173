// The order of search results. Sphinx adds up points for words in titles and texts; the kinds of
// pages then add or subtract some, so that guides come before pages that list every name.
var Scorer = {
  points: [
    [/^(install|first_mechanism)$/, 12],
    [/^how_to\//, 8],
    [/^tutorials\//, 6],
    [/^(notebooks|generated\/(gallery|commands|mechanisms|analyses))\//, -4],
    [/^generated\/(api|changelog|contributing)/, -8],
    [/^(architecture|decisions|dependencies|benchmarks|extremes|cross_checks)$/, -8],
  ],
  score: ([docname, , , , score]) =>
    Scorer.points.reduce((sum, [pages, points]) => sum + (pages.test(docname) ? points : 0), score),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: {0: 15, 1: 5, 2: -5},
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};

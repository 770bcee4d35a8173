// The order of search results. Sphinx adds up points for words in titles, headings and texts. Here a
// page whose own title has a word of the search gets more, and so do guides; pages that list many
// names, and lists of pages, get fewer.
var Scorer = {
  titleWord: 6,
  points: [
    [/^install$/, 12],
    [/^(how_to|tutorials)\//, 8],
    [/^first_mechanism$/, 4],
    [/^(notebooks|generated\/(gallery|commands|mechanisms|analyses))\//, -4],
    [/(^sections\/|\/index$|^generated\/(api|changelog|contributing))/, -10],
    [/^(architecture|decisions|dependencies|benchmarks|extremes|cross_checks)$/, -8],
  ],
  score: ([docname, title, anchor, , score]) => {
    const words = (new URLSearchParams(location.search).get("q") || "").toLowerCase().split(/\s+/);
    if (!anchor)
      for (const word of words)
        if (word && title.toLowerCase().includes(word)) score += Scorer.titleWord;
    for (const [pages, points] of Scorer.points) if (pages.test(docname)) score += points;
    return score;
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: {0: 15, 1: 5, 2: -5},
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};

// How Sphinx's search orders what it finds: places that have the name, then pages that explain, then records of what was.
// What it finds in the index is called by its page alone; so is the page itself. Here it gets its own name, too.
var Scorer = {
  score: (result) => {
    const [page, title, anchor, , score, , kind] = result;
    if (kind === "index" && anchor) result[1] = `${title} > ${anchor.replace(/^#(row-)?|-+$/g, "")}`;
    return /^(changelog|decisions|licences|tries|results-|notebooks\/)/.test(page) ? score - 4 : score;
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};

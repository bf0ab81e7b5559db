// Tables sort by a click on a heading, or by Enter or Space on it: first ascending, then descending, then as they were.
// Amounts (data-n) sort before words, and cells without anything to say come last.
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0];
  // A remark stays below its row.
  const groups = [];
  for (const row of body.rows) {
    if (row.classList.contains("reason") && groups.length) groups[groups.length - 1].push(row);
    else groups.push([row]);
  }
  const key = (group, column) => {
    const cell = group[0].cells[column];
    const text = cell ? cell.textContent.trim() : "";
    const number = cell && "n" in cell.dataset ? parseFloat(cell.dataset.n) : NaN;
    return { number, text, empty: text === "" || text === "–" };
  };
  const compare = (a, b, sign) => {
    if (a.empty || b.empty) return a.empty - b.empty;
    const words = [a, b].map(({ number }) => Number.isNaN(number));
    if (words[0] !== words[1]) return words[0] - words[1];
    if (words[0]) return sign * a.text.localeCompare(b.text, undefined, { numeric: true });
    return a.number === b.number ? 0 : sign * (a.number < b.number ? -1 : 1);
  };
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...heading.childNodes);
    heading.append(button);
    button.addEventListener("click", () => {
      const next = { ascending: "descending", descending: null }[heading.getAttribute("aria-sort")];
      const order = next === undefined ? "ascending" : next;
      headings.forEach((other) => other.removeAttribute("aria-sort"));
      let sorted = groups;
      if (order) {
        heading.setAttribute("aria-sort", order);
        const sign = order === "ascending" ? 1 : -1;
        const keyed = groups.map((group) => ({ group, key: key(group, column) }));
        sorted = keyed.sort((a, b) => compare(a.key, b.key, sign)).map(({ group }) => group);
      }
      body.append(...sorted.flat());
    });
  });
}

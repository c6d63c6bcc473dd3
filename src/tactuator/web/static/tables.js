"use strict";
// Tables: of results, and a confusion matrix whose cells are shaded by their share of the row.
function resultTable({ caption, columns, rows, notes }) {
  const table = columns[0] === "" ? confusionTable(columns.slice(1), rows.map((cells) => cells.slice(1).map(Number))) : plainTable(columns, rows);
  table.prepend(make("caption", {}, caption));
  return [table, ...notes.map((note) => make("p", { class: "note" }, note))];
}

function plainTable(columns, rows) {
  const head = make("tr", {}, ...columns.map((text) => make("th", { scope: "col" }, text)));
  const body = rows.map((cells) => make("tr", {}, ...cells.map((text) => make("td", {}, text))));
  return make("table", {}, make("thead", {}, head), make("tbody", {}, ...body));
}

function confusionTable(labels, counts) {
  const head = make("tr", {}, make("th", { scope: "col" }, word("matrix")),
    ...labels.map((label) => make("th", { scope: "col" }, label)));
  const rows = labels.map((label, row) => {
    const total = counts[row].reduce((sum, count) => sum + count, 0);
    const cells = counts[row].map((count, column) => {
      const cell = make("td", { class: row === column ? "right" : "" }, count === 0 ? "\u00b7" : String(count));
      cell.style.setProperty("--share", total === 0 ? "0%" : `${Math.round(70 * count / total)}%`);
      return cell;
    });
    return make("tr", {}, make("th", { scope: "row" }, label), ...cells);
  });
  return make("table", { class: labels.length > 8 ? "matrix many" : "matrix" }, make("thead", {}, head), make("tbody", {}, ...rows));
}

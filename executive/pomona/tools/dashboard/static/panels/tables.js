// Tables that skills publish.
import { h } from "../dom.js";

export const title = "Tables";

let shown = [];
export function draw(box, { tables }) {
  const now = [...tables.values()]; // a table that is published anew is another object, even with as many rows
  if (now.length !== shown.length || now.some((table, i) => table !== shown[i])) box.replaceChildren(...now.map(element));
  shown = now;
  return tables.size > 0;
}

function element({ caption, columns, rows }) {
  const body = rows.map((row) => h("tr", {}, row.map((cell) => h("td", {}, cell))));
  return h("table", {}, h("caption", {}, caption), h("thead", {}, h("tr", {}, columns.map((c) => h("th", {}, c)))), h("tbody", {}, body));
}

// Tables that skills publish.
import { h } from "../dom.js";

export const title = "Tables";

let shown = "";
export function draw(box, { run, tables }) {
  const key = `${run?.run}|${[...tables.values()].map((table) => `${table.caption}${table.rows.length}`).join("|")}`;
  if (key !== shown) box.replaceChildren(...[...tables.values()].map(element));
  shown = key;
  return tables.size > 0;
}

function element({ caption, columns, rows }) {
  const body = rows.map((row) => h("tr", {}, row.map((cell) => h("td", {}, cell))));
  return h("table", {}, h("caption", {}, caption), h("thead", {}, h("tr", {}, columns.map((c) => h("th", {}, c)))), h("tbody", {}, body));
}

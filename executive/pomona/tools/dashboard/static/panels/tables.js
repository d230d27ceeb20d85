// Tables that skills publish.
import { h } from "../dom.js";
import { showAge } from "../pictures.js";

export const title = "Tables";

let shown = [];
export function draw(box, state) {
  const { tables } = state, now = [...tables.values()]; // a table that is published anew is another object, even with as many rows
  if (now.length !== shown.length || now.some((table, i) => table !== shown[i])) box.replaceChildren(...now.map(element));
  shown = now;
  [...box.querySelectorAll("caption small")].forEach((age, i) => showAge(age, now[i].t, state));
  return tables.size > 0;
}

function element({ caption, columns, rows }) {
  const body = rows.map((row) => h("tr", {}, row.map((cell) => h("td", {}, cell))));
  return h("table", {}, h("caption", {}, `${caption} `, h("small")), h("thead", {}, h("tr", {}, columns.map((c) => h("th", {}, c)))), h("tbody", {}, body));
}

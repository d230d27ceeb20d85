// The menu of a node.
import { $, h } from "./shared/dom.js";

let leave = () => {};

export function openMenu(actions, x, y, after) {
  const menu = $("menu");
  menu.replaceChildren(...actions.flatMap(({ words, key, run, disabled, line }) => [
    h("button", { role: "menuitem", tabindex: "-1", disabled, onclick: () => { close(); run(); } }, words, h("kbd", {}, key)), line ? h("hr", {}) : null].filter(Boolean)));
  menu.hidden = false;
  const { width, height } = menu.getBoundingClientRect();
  menu.style.left = `${Math.max(4, Math.min(x, innerWidth - width - 4))}px`;
  menu.style.top = `${Math.max(4, Math.min(y, innerHeight - height - 4))}px`;
  leave = after;
  items()[0]?.focus();
}

const items = () => [...$("menu").querySelectorAll("button:not(:disabled)")];

function close() {
  if ($("menu").hidden) return;
  $("menu").hidden = true;
  leave();
}

$("menu").addEventListener("keydown", (event) => {
  const all = items(), at = all.indexOf(document.activeElement), by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (by) all[(at + by + all.length) % all.length]?.focus();
  else if (event.key === "Home") all[0]?.focus();
  else if (event.key === "End") all.at(-1)?.focus();
  else if (event.key === "Escape" || event.key === "Tab") close();
  else return;
  event.preventDefault();
  event.stopPropagation();
});
addEventListener("pointerdown", (event) => { if (!$("menu").contains(event.target)) close(); }, true);

// The help: first steps, and what keys do.
import { $, h } from "./shared/dom.js";

export function showKeys(actions) {
  const kbd = (keys) => keys.split(" ").map((key) => [h("kbd", {}, key), " "]), line = ([keys, words]) => [h("dt", {}, kbd(keys)), h("dd", {}, words)];
  $("keys-list").replaceChildren(
    h("h3", {}, "First steps"),
    h("ol", {}, ["A tree runs from the top to the bottom. A sequence goes on while its children succeed; a fallback tries the next child when one has failed.",
      "Insert a node with i (after the selected one) or a (inside it). The palette finds skills by purpose, port and failure code.",
      "Enter goes to the values of a node. Beside each field are the units, choices and wires that fit. A wire in braces carries an output to a later input.",
      "A modifier (m) wraps one node: retry 3, timeout 5 s. Wrap (w) puts a node into a sequence or fallback.",
      "An error is shown at its node and line; Apply follows its hint. Dry run tries the logic without a cell.",
      "Nothing is written before Save. A draft is kept meanwhile: a closed browser loses nothing."].map((words) => h("li", {}, words))),
    h("h3", {}, "In the tree"),
    h("dl", { class: "facts" }, [["↑ ↓", "select"], ["← →", "go to the parent, to the first child"], ["Enter", "edit the values; Esc comes back"], [".", "apply the hint of the selected node"], ["Shift+F10", "menu of all edits"],
      ...Object.values(actions).map(({ key, words }) => [key, words.replace(" …", "")])].map(line)),
    h("h3", {}, "Everywhere"),
    h("dl", { class: "facts" }, [["Ctrl+Z Ctrl+Y", "undo, redo: without limit"], ["Ctrl+S", "save"], ["Ctrl+Enter", "dry run"], ["F6", "next pane: tree, node, text"], ["F8", "next finding"], ["/", "find a node"], ["?", "this help"]].map(line)));
  $("keys").showModal();
}

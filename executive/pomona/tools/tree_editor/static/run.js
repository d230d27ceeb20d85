// The dialog before a simulated run: seed, pace, parameters of the tree and options of the cell.
import { $, h } from "./shared/dom.js";
import { page } from "./model.js";

const given = {}; // values of the last start, by name

const field = ({ name, type, default: usual, choices, help }) => h("label", { class: "field", title: help }, h("span", {}, name, " ", h("small", {}, type ?? "")),
  choices?.length ? h("select", { name }, ["", ...choices].map((value) => h("option", { value, selected: value === (given[name] ?? "") }, value || `${usual} (usual)`))) : h("input", { name, value: given[name] ?? "", placeholder: usual, maxlength: 200, autocomplete: "off" }));

// `start` begins a run; it returns the problem of a value, with which the dialog stays open.
export function askRun(start) {
  const group = (title, fields) => (fields.length ? h("fieldset", { class: "fields" }, h("legend", {}, title), fields.map(field)) : null);
  $("run-fields").replaceChildren(...[group("Parameters of the tree", page.state.parameters), group(`Options of the cell ${page.cell}`, page.options)].filter(Boolean));
  $("run-problem").textContent = "";
  $("run-form").onsubmit = async (event) => {
    event.preventDefault();
    const values = [...$("run-fields").querySelectorAll("[name]")];
    for (const { name, value } of values) given[name] = value.trim();
    $("run-problem").textContent = await start({ seed: Number($("run-seed").value), real_time: $("run-pace").value === "real", settings: Object.fromEntries(values.filter(({ value }) => value.trim()).map(({ name, value }) => [name, value.trim()])) }) ?? "";
    if (!$("run-problem").textContent) $("run-ask").close();
  };
  $("run-ask").showModal();
}

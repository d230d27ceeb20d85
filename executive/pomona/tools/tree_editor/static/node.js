// The selected node: its findings, its name and comment, and typed fields for its ports and modifiers.
import { $, h } from "./shared/dom.js";
import { bare, entryOf, findingsOf, holdsNodes, isCondition, kindOf, labelOf, node, page, rewrite, yaml } from "./model.js";
import { capital, facts } from "./palette.js";
import { post } from "./talk.js";

export class NodePane {
  // `on`: edit(edit, words), mend(number), act(name)
  constructor(on) {
    Object.assign(this, { on, root: $("node"), offers: {}, asked: "" });
  }

  // Show the selected node; a field that had the keyboard keeps it.
  update() {
    const key = document.activeElement?.closest?.("#node [data-key]")?.dataset.key, typed = this.typing();
    const one = node();
    this.root.replaceChildren(...(one ? this.sheet(one) : this.tree()).flat(Infinity).filter(Boolean));
    if (key) (this.root.querySelector(`[data-key="${CSS.escape(key)}"]`) ?? this.root).focus();
    if (typed) { const field = this.root.querySelector(`[data-key="${CSS.escape(typed.key)}"]`); if (field && typed.one === page.selected) field.value = typed.value; }
    if (one) this.ask(one);
  }

  // A value that is being typed and not yet taken over.
  typing() {
    const field = document.activeElement;
    return field?.matches?.("#node input[data-key]") && field.dataset.was !== undefined && field.value !== field.dataset.was ? { key: field.dataset.key, value: field.value, one: this.one } : null;
  }

  focusFirst() {
    const fields = [...this.root.querySelectorAll("input[data-key]")];
    (fields.find((field) => field.dataset.needed && !field.value) ?? fields.find((field) => field.dataset.key.startsWith("port ")) ?? fields[0])?.focus();
  }

  // Which wires fit which port: by type, from the names in scope.
  async ask(one) {
    const text = page.text, key = `${one.id}|${one.type}|${text.length}|${page.version}`;
    if (key === this.asked || page.old) return;
    this.asked = key;
    const answer = await post("offers", { text, definition: one.tree, kind: one.type });
    if (this.asked !== key || answer.error) return;
    this.offers = answer.ports;
    for (const select of this.root.querySelectorAll("select[data-port]")) fill(select, select.facts, this.offers[select.dataset.port]);
  }

  sheet(one) {
    this.one = one.id;
    const kind = kindOf(one);
    const only = isCondition(one) ? [h("h3", {}, "Value"), this.entry(`port ${one.type}`, { ...kind.value, name: "condition" }, bare(one.ports[0].text), (value) => rewrite(one, value))] : null;
    return [
      h("p", { class: "about" }, h("strong", {}, `${kind.symbol} ${labelOf(one)}`), h("span", { class: "muted" }, kind.unknown ? "no skill, word or subtree of this name" : one.kind && one.name ? `${one.type}: ${kind.summary}` : capital(kind.summary))),
      findingsOf(one.id).map((finding) => this.fault(finding)),
      ...(only ?? this.rest(one, kind)),
    ];
  }

  rest(one, kind) {
    const modifiers = one.modifiers, small = page.small;
    const inputs = kind.inputs ?? [], outputs = kind.outputs ?? [], known = new Set([...inputs, ...outputs].map(({ name }) => name)), ports = one.ports;
    const extra = ports.map(({ name }) => name).filter((name) => name !== one.type && !known.has(name) && kind.value?.type !== "nodes" && !kind.value?.inputs?.some((port) => port.name === name));
    const own = kind.value && !["nodes", "nothing", "assignments"].includes(kind.value.type) && !kind.value.inputs && kind.role !== "composite" || kind.value?.name === "switch" ? kind.value : null;
    return [
      h("div", { class: "actions" }, [["insert", "Insert after"], ["inside", "Insert inside"], ["wrap", "Wrap"], ["modifier", "Modifier"], ["duplicate", "Duplicate"], ["remove", "Delete"]]
        .filter(([name]) => name !== "inside" || holdsNodes(one.type)).map(([name, words]) => h("button", { onclick: () => this.on.act(name), disabled: !page.mayAct }, words))),
      own ? [h("h3", {}, "Value"), this.entry(`port ${one.type}`, own, bare(entryOf(ports, one.type)), (value) => ({ do: "set_port", node: one.id, port: one.type, value: yaml(value) }))] : null,
      inputs.length || extra.length ? [h("h3", {}, "Inputs"), [...inputs, ...extra.map((name) => ({ name, type: "", help: "" }))].map((port) => this.port(one, port))] : null,
      kind.value?.inputs?.length ? [h("h3", {}, "Values"), kind.value.inputs.filter(({ name }) => !known.has(name)).map((port) => this.port(one, port))] : null,
      outputs.length ? [h("h3", {}, "Outputs"), outputs.map((port) => this.port(one, { ...port, output: true }))] : null,
      (kind.fields ?? []).filter((field) => !field.nodes).length ? [h("h3", {}, "Beside it"), kind.fields.filter((field) => !field.nodes).map((field) => this.entry(`modifier ${field.name}`, field, bare(entryOf(one.modifiers, field.name)), (value) => ({ do: "set_modifier", node: one.id, modifier: field.name, value: yaml(value) })))] : null,
      h("h3", {}, "Modifiers", small ? null : h("button", { class: "quiet", onclick: () => this.on.act("modifier"), disabled: !page.mayAct, title: "m" }, "Add …")),
      modifiers.filter((entry) => !(kind.fields ?? []).some(({ name }) => name === entry.name)).map((entry) => this.modifier(one, entry.name, entry.text)),
      modifiers.flatMap((entry) => page.catalogue.words[entry.name]?.fields ?? []).filter((field) => !field.nodes && !modifiers.some(({ name }) => name === field.name)).map((field) => this.modifier(one, field.name, "")),
      small ? null : [h("h3", {}, "For readers"), this.plainEntry("name", "Name", one.name, "shown instead of the type; unique in its tree", (name) => ({ do: "rename", node: one.id, name })),
        this.plainEntry("comment", "Comment", one.comment, "a line above the node, for the operator as well", (comment) => ({ do: "comment", node: one.id, text: comment }))],
      kind.failures?.length ? [h("h3", {}, "Fails with"), h("ul", { class: "codes" }, kind.failures.map(({ code, meaning, remedy }) => h("li", {}, h("code", {}, code), meaning ? ` ${meaning}` : "", remedy ? h("div", { class: "muted" }, remedy) : null)))] : null,
      one.id === "root" ? this.parameters() : null,
    ];
  }

  // Without a node: the tree's parameters.
  tree() {
    this.one = "";
    return [h("p", { class: "about" }, h("strong", {}, "Tree"), h("span", { class: "muted" }, "Select a node to change its values.")), this.parameters()];
  }

  parameters() {
    const { parameters } = page.state;
    return [
      parameters.length ? h("h3", {}, "Parameters of the tree") : null,
      parameters.map((parameter) => this.entry(`parameter ${parameter.name}`, { ...parameter, default: "", required: false }, bare(parameter.default), (value) => ({ do: "set_parameter", name: parameter.name, value: yaml(value) }))),
    ];
  }

  fault(finding) {
    return h("div", { class: `fault ${finding.severity}` }, finding.message, finding.hint ? h("div", { class: "muted" }, finding.hint) : null,
      finding.mends && page.mayAct ? h("button", { onclick: () => this.on.mend(finding.number) }, "Apply the hint") : null);
  }

  port(one, port) {
    return this.entry(`port ${port.name}`, port, bare(entryOf(one.ports, port.name)), (value) => ({ do: "set_port", node: one.id, port: port.name, value: yaml(value) }));
  }

  modifier(one, word, value) {
    const owner = page.catalogue.words[word] ?? Object.values(page.catalogue.words).find(({ fields }) => fields.some(({ name }) => name === word));
    const field = owner?.name === word ? owner.value : owner?.fields.find(({ name }) => name === word);
    const entry = this.entry(`modifier ${word}`, { ...(field ?? { type: "" }), name: word, help: owner?.name === word ? owner.summary : field?.help }, bare(value), (text) => ({ do: "set_modifier", node: one.id, modifier: word, value: yaml(text) }));
    if (value) entry.querySelector(".combo").append(h("button", { "aria-label": `Remove ${word}`, title: "Remove", disabled: !page.mayAct, onclick: () => this.on.edit({ do: "set_modifier", node: one.id, modifier: word, value: null }, `remove ${word}`) }, "×"));
    return entry;
  }

  // One typed field: the value as text, and beside it the units, choices and wires that fit.
  entry(key, port, value, made) {
    const wrong = this.wrong(port.name), [input, commit] = this.input(key, value, (text) => this.on.edit(made(text), `${port.name}: ${text || "not set"}`), {
      "data-needed": port.required, spellcheck: "false", placeholder: port.default !== undefined && port.default !== "" && !key.startsWith("parameter") ? port.default : port.output ? `{${port.name}}` : "", "aria-invalid": wrong ? "true" : null,
    });
    const select = h("select", { "data-port": port.name, "data-key": `${key} offers`, "aria-label": `units, choices and wires for ${port.name}`, disabled: !page.mayAct });
    select.facts = port;
    fill(select, port, this.offers[port.name]);
    select.addEventListener("change", () => {
      const [rank, word] = [select.value[0], select.value.slice(1)];
      input.value = rank === "u" ? `${input.value.match(/^\s*[-+\d.eE]*/)[0].trim() || "1"} ${word}` : word;
      select.value = "";
      commit();
    });
    return h("div", { class: "entry" },
      h("div", { class: "label" }, h("label", { for: input.id }, h("b", {}, port.name)), h("span", { class: "help" }, facts({ ...port, required: false })), port.required && !value ? h("span", { class: "needed" }, "needed") : null),
      h("div", { class: "combo" }, input, select),
      h("div", { class: "help", id: `${input.id}-help` }, port.help ?? ""));
  }

  plainEntry(key, label, value, help, made) {
    const [input] = this.input(key, value ?? "", (text) => this.on.edit(made(text), label.toLowerCase()));
    return h("div", { class: "entry" }, h("div", { class: "label" }, h("label", { for: input.id }, h("b", {}, label))), input, h("div", { class: "help", id: `${input.id}-help` }, help));
  }

  // A field, and what takes its value over: when it has changed, and once.
  input(key, value, change, more = {}) {
    const id = `field-${key.replaceAll(/\W/g, "-")}`, input = h("input", { id, "data-key": key, "data-was": value, value, autocomplete: "off", readonly: !page.mayAct, "aria-describedby": `${id}-help`, ...more });
    input.value = value;
    const commit = () => { const text = input.value.trim(); if (text !== input.dataset.was) { input.dataset.was = text; change(text); } };
    input.addEventListener("change", commit);
    input.addEventListener("keydown", (event) => {
      if (event.key === "Escape") { input.value = input.dataset.was; this.on.leave(); event.stopPropagation(); } else if (event.key === "Enter") commit(); else return;
      event.preventDefault();
    });
    return [input, commit];
  }

  wrong(name) { return findingsOf(page.selected).some(({ message, severity }) => severity === "error" && (message.includes(`'${name}'`) || message.includes(`.${name}`))); }
}

// Units replace the unit of the value, choices and wires replace the value.
function fill(select, port, wires = []) {
  const group = (label, rank, words) => (words?.length ? h("optgroup", { label }, words.map(({ word, about: words_ }) => h("option", { value: rank + word }, words_ ? `${word}   ${words_}` : word))) : null);
  const asWords = (words) => words?.map((word) => ({ word }));
  const own = port.output ? [{ word: `{${port.name}}`, about: "a name of its own" }] : [];
  const parts = [group("Units", "u", asWords(port.units)), group("Choices", "c", asWords(port.choices)), group("Wires", "w", [...own, ...wires.filter(({ word }) => !own.some((one) => one.word === word) && !(port.output && word.includes(".")))])].filter(Boolean);
  select.replaceChildren(h("option", { value: "" }, port.units?.length ? "unit" : parts.length ? "choose" : "–"), ...parts);
  select.hidden = !parts.length;
}

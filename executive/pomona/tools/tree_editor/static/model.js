// What the page shows: the text, its nodes, and what is known about them.

export const page = {
  text: "", stamp: "", problem: "", disk: "", mayAct: false, small: false,
  state: { nodes: [], findings: [], definitions: [], parameters: [], problem: "" },
  old: false, // the drawing is of an earlier text, since the present one cannot be read
  catalogue: { skills: {}, words: {}, subtree: { symbol: "▣", colour: "#6c4ab6" }, types: [] },
  selected: "", nodes: new Map(), below: new Map(), trial: null,
};

export function take(state) {
  page.old = !state.nodes.length && Boolean(state.problem || state.findings.length) && Boolean(page.text.trim());
  page.state = page.old ? { ...state, nodes: page.state.nodes, definitions: page.state.definitions, parameters: page.state.parameters } : state;
  page.nodes = new Map(page.state.nodes.map((node) => [node.id, node]));
  page.below = new Map();
  const below = (id) => (page.below.has(id) ? page.below : page.below.set(id, [])).get(id);
  for (const node of page.state.nodes) if (node.index >= 0) below(node.parent).push(node);
  for (const node of page.state.nodes) if (node.index < 0) below(node.parent).push(node); // what a modifier does comes after the children
  const walk = (node) => [node, ...(page.below.get(node.id) ?? []).flatMap(walk)];
  page.state.nodes = (page.below.get("") ?? []).flatMap(walk);
  if (!page.nodes.has(page.selected)) page.selected = nearest(page.selected);
}

export const node = (id = page.selected) => page.nodes.get(id);
export const children = (id) => page.below.get(id) ?? [];
export const siblings = (one) => (one.parent ? children(one.parent) : []);
export const entryOf = (list, name) => list?.find((entry) => entry.name === name)?.text ?? "";

// After a removal: the next sibling, the one before, or the parent.
function nearest(id) {
  for (let at = id; at.includes("/");) {
    const [, parent, index] = at.match(/^(.*)\/(\d+)$/) ?? [, "", "0"];
    for (let i = Number(index); i >= 0; i -= 1) if (page.nodes.has(`${parent}/${i}`)) return `${parent}/${i}`;
    if (!parent) break;
    if (page.nodes.has(parent)) return parent;
    at = parent;
  }
  return page.state.nodes[0]?.id ?? "";
}

// What the catalogue knows of a node's type: a skill, a word or a subtree of this file.
export function about(type) {
  const { skills, words, subtree } = page.catalogue;
  if (Object.hasOwn(skills, type)) return skills[type];
  if (Object.hasOwn(words, type)) return words[type];
  const called = page.state.definitions.find(({ name }) => name && name === type);
  const ports = called?.ports ?? [];
  return {
    name: type, role: "subtree", summary: called?.description || "a subtree of this file", ...subtree, failures: [],
    inputs: ports.filter(({ direction }) => direction === "input"), outputs: ports.filter(({ direction }) => direction === "output"), unknown: !called,
  };
}

// Of a node; a condition that stands where a node may stand is no node of its own.
export const isCondition = (one) => !one.kind && Boolean(one.slot) && one.ports.length === 1;
export const kindOf = (one) => (isCondition(one) ? { ...page.catalogue.words.check, summary: "a condition; a node may stand here instead" } : about(one.type));
export const labelOf = (one) => one.name || (isCondition(one) ? "condition" : one.type || "?");

export const holdsNodes = (type) => about(type).value?.type === "nodes";
export const findingsOf = (id) => page.state.findings.filter((one) => nodeAt(one.line)?.id === id);
// The innermost node of a line.
export function nodeAt(line) {
  let found = null;
  for (const one of page.state.nodes) if (one.line <= line && line <= one.end_line) found = one; // those below come later
  return found;
}

// A value without its quotes, as a field shows it; and a field's words as YAML.
export function bare(text = "") {
  text = text.replace(/\s*\n\s*/g, " "); // YAML folds the lines of a text
  if (/^"[^]*"$/.test(text)) try { return JSON.parse(text); } catch { return text; }
  return /^'[^]*'$/.test(text) ? text.slice(1, -1).replaceAll("''", "'") : text;
}

// An edit that writes a condition anew.
export const rewrite = (one, words) => ({ do: "set_port", node: one.id, port: one.type, value: yaml(words) ?? '""' });

export function yaml(words) {
  if (words === "") return null;
  if (/^("(\\.|[^"\\])*"|'([^']|'')*'|\[([^[\]]|\[[^[\]]*\])*\]|\{[^{}"']*:.*\})$/.test(words)) return words; // YAML already: a quoted text, a list, a mapping
  return /[{}[\]#,&*!|>%@`"']|:(\s|$)|^[-?](\s|$)|^\s|\s$|^(~|null)$/i.test(words) ? JSON.stringify(words) : words;
}

// The text beside the drawing: line numbers, findings at their lines, and the lines of the selected node.
import { $, h } from "./shared/dom.js";
import { node, nodeAt, page } from "./model.js";

const LINE = 18, TOP = 6; // px, as in the style

export class TextPane {
  // `on`: typed(text, selection), place(id), mend(number)
  constructor(on) {
    Object.assign(this, { on, area: $("area"), numbers: document.querySelector(".numbers"), bands: document.querySelector(".bands"), lines: 0 });
    this.area.addEventListener("input", () => { this.on.typed(this.area.value); });
    this.area.addEventListener("scroll", () => this.scrolled(), { passive: true });
    this.area.addEventListener("beforeinput", (event) => { if (event.inputType.startsWith("history")) event.preventDefault(); }); // undo is the page's
    this.area.addEventListener("keydown", (event) => this.key(event));
    for (const kind of ["keyup", "click"]) this.area.addEventListener(kind, () => this.caret());
  }

  set(text) {
    if (this.area.value === text) return;
    const { scrollTop, scrollLeft, selectionStart } = this.area, focused = document.activeElement === this.area;
    this.area.value = text;
    if (focused) this.area.setSelectionRange(selectionStart, selectionStart);
    Object.assign(this.area, { scrollTop, scrollLeft });
  }

  // A new line begins where the last one did; Tab inserts two spaces only with a selection of several lines.
  key(event) {
    if (event.key !== "Enter" || event.ctrlKey || event.altKey || event.metaKey) return;
    const { selectionStart: at, value } = this.area, line = value.slice(value.lastIndexOf("\n", at - 1) + 1, at);
    const indent = line.match(/^ */)[0] + (/:\s*$/.test(line) ? "  " : /^\s*- /.test(line) ? "" : "");
    event.preventDefault();
    this.area.setRangeText(`\n${indent}`, at, this.area.selectionEnd, "end");
    this.on.typed(this.area.value);
  }

  caret() {
    const line = this.area.value.slice(0, this.area.selectionStart).split("\n").length;
    $("place").textContent = `line ${line}`;
    const found = nodeAt(line);
    if (found && !page.old) this.on.place(found.id);
  }

  update() {
    const count = page.text.split("\n").length;
    if (count !== this.lines) {
      this.lines = count;
      this.count = Array.from({ length: count }, (_, i) => i + 1).join("\n");
    }
    const worst = new Map();
    for (const finding of page.state.findings) if (worst.get(finding.line)?.severity !== "error") worst.set(finding.line, finding);
    this.numbers.replaceChildren(this.count, ...[...worst].map(([line, finding]) => {
      const sign = h("span", { class: finding.severity, title: finding.message }, finding.severity === "error" ? "✖" : "▲");
      sign.style.cssText = `position:absolute;left:2px;top:${TOP + (line - 1) * LINE}px`;
      return sign;
    }));
    this.worst = worst;
    $("findings").replaceChildren(...page.state.findings.slice(0, 100).map((finding) => h("li", { class: finding.severity },
      h("button", { class: "moment", onclick: () => this.go(finding) }, finding.line ? `line ${finding.line}` : "file"),
      h("span", {}, finding.message, finding.hint ? h("span", { class: "muted" }, ` ${finding.hint}`) : null),
      finding.mends && page.mayAct ? h("button", { onclick: () => this.on.mend(finding.number), "aria-label": `Apply: ${finding.hint || finding.message}` }, "Apply") : null)));
    this.select(false);
  }

  go(finding) {
    this.reveal(finding.line);
    this.area.focus();
    const lines = page.text.split("\n"), start = lines.slice(0, finding.line - 1).reduce((sum, line) => sum + line.length + 1, 0) + Math.max(0, finding.column - 1);
    this.area.setSelectionRange(start, start + finding.length);
    this.caret();
  }

  reveal(line) {
    const y = TOP + (line - 1) * LINE, { scrollTop, clientHeight } = this.area;
    if (y < scrollTop || y + LINE > scrollTop + clientHeight) this.area.scrollTop = Math.max(0, y - clientHeight / 3);
  }

  // Mark the lines of the selected node.
  select(into = true) {
    const one = page.old ? null : node(), bands = [];
    const band = (from, to, rank) => { const made = h("div", { class: rank }); made.style.cssText = `top:${TOP + (from - 1) * LINE}px;height:${(to - from + 1) * LINE}px`; bands.push(made); };
    if (one) band(one.line, Math.max(one.line, one.end_line), "chosen");
    for (const [line, finding] of this.worst ?? []) if (line) band(line, line, finding.severity);
    this.bands.replaceChildren(...bands);
    if (one && into && document.activeElement !== this.area) this.reveal(one.line);
    this.scrolled();
  }

  scrolled() {
    this.numbers.style.transform = this.bands.style.transform = `translateY(${-this.area.scrollTop}px)`;
  }
}

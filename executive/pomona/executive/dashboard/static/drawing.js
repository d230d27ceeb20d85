// The tree as `pomona show --svg` draws it, each box in the colour of its node's state; a box is chosen as a row is.
import { $, h } from "./dom.js";
import { read } from "./page.js";
import { standing } from "./store.js";

const CLASSES = ["good", "bad", "busy", "cut", "past"];

export class DrawingView {
  constructor(onPick) {
    this.root = $("drawing");
    Object.assign(this, { onPick, run: null, boxes: [], key: "" });
  }

  // `nodes`: the tree's rows in their order, which is that of the drawing.
  update(state, nodes, selected) {
    if (document.body.dataset.large !== "drawing" || !state.run) return;
    if (this.run !== state.run.run) { this.load(state.run.run, nodes); return; }
    const ranks = this.boxes.map(({ path }) => standing(state.node.get(path)).rank);
    const key = `${ranks}|${selected}`;
    if (key === this.key) return;
    this.key = key;
    this.boxes.forEach(({ path, box }, i) => {
      for (const name of CLASSES) box.classList.toggle(name, ranks[i] === name);
      box.classList.toggle("chosen", path === selected);
    });
  }

  async load(run, nodes) {
    Object.assign(this, { run, boxes: [], key: "" });
    let problem = "The tree of this run is not recorded: there is no drawing.";
    try {
      const answer = await read(`/api/runs/${encodeURIComponent(run)}/drawing`);
      if (this.run !== run) return;
      if (answer.ok) {
        const picture = document.importNode(new DOMParser().parseFromString(await answer.text(), "image/svg+xml").documentElement, true);
        const boxes = [...picture.querySelectorAll(":scope > g")];
        if (boxes.length === nodes.length) this.boxes = boxes.map((box, i) => ({ box, path: nodes[i] }));
        for (const { box, path } of this.boxes) box.addEventListener("click", () => this.onPick(path));
        this.root.replaceChildren(picture);
        return;
      }
    } catch (error) { problem = `The drawing cannot be read: ${error.message}`; this.run = null; }
    this.root.replaceChildren(h("p", { class: "empty" }, problem));
  }
}

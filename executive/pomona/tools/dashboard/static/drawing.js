// The tree as `pomona show --svg` draws it, each box in the colour of its node's state; a box is chosen as a row is.
import { $, h } from "./dom.js";
import { page, read } from "./page.js";
import { standing } from "./store.js";

const WRITTEN = 1000, TRIES = 5; // ms until a record that is being written is read again, and how often
const SCALE = 0.72; // of a box on the page to one in a file
const CLASSES = ["good", "bad", "busy", "cut", "past"];

export class DrawingView {
  constructor(onPick) {
    this.root = $("drawing");
    Object.assign(this, { onPick, run: null, boxes: [], key: "", picture: null });
  }

  // `nodes`: the tree's rows in their order, which is that of the drawing.
  update(state, nodes, selected, scale) {
    if (document.body.dataset.large !== "drawing" || !state.run) return;
    const run = `${encodeURIComponent(state.run.run)}/drawing?until=${state.changed}`;
    if (this.run !== run) { this.load(run, nodes); return; }
    if (this.picture && this.scale !== scale) {
      this.scale = scale;
      for (const side of ["width", "height"]) this.picture.setAttribute(side, this.size[side] * SCALE * scale);
      this.seen = -1;
      this.key = "";
    }
    const ranks = this.boxes.map(({ path }) => standing(state.node.get(path)).rank);
    const key = `${ranks}|${selected}`;
    if (key === this.key) return;
    this.key = key;
    const chosen = this.boxes.findIndex(({ path }) => path === selected), seen = chosen >= 0 ? chosen : ranks.lastIndexOf("busy");
    if (seen >= 0 && seen !== this.seen) this.show(this.boxes[seen].box);
    this.seen = seen;
    this.boxes.forEach(({ path, box }, i) => {
      for (const name of CLASSES) box.classList.toggle(name, ranks[i] === name);
      box.classList.toggle("chosen", path === selected);
    });
  }

  // In the middle of its panel; the page itself stays where it is.
  show(box) {
    const there = box.getBoundingClientRect(), here = this.root.getBoundingClientRect();
    this.root.scrollBy(there.left + there.width / 2 - here.left - here.width / 2, there.top + there.height / 2 - here.top - here.height / 2);
  }

  async load(run, nodes) {
    Object.assign(this, { run, boxes: [], key: "", seen: -1, picture: null });
    let problem = "The tree of this run is not recorded: there is no drawing.";
    try {
      const answer = await read(`/api/runs/${run}`);
      if (this.run !== run) return;
      if (answer.ok) {
        const picture = document.importNode(new DOMParser().parseFromString(await answer.text(), "image/svg+xml").documentElement, true);
        const boxes = [...picture.querySelectorAll(":scope > g")];
        this.tries = this.of === run ? this.tries + 1 : 1;
        this.of = run;
        if (boxes.length !== nodes.length && this.tries < TRIES) setTimeout(() => { if (this.run === run) this.run = null; page.dirty = true; }, WRITTEN); // the change is not in the record yet
        if (boxes.length === nodes.length) this.boxes = boxes.map((box, i) => ({ box, path: nodes[i] }));
        for (const { box, path } of this.boxes) box.addEventListener("click", () => this.onPick(path));
        Object.assign(this, { picture, scale: null, size: { width: picture.getAttribute("width"), height: picture.getAttribute("height") } });
        this.root.replaceChildren(picture);
        page.dirty = true;
        return;
      }
    } catch (error) { problem = `The drawing cannot be read: ${error.message}`; this.run = null; }
    this.root.replaceChildren(h("p", { class: "empty" }, problem));
  }
}

// Undo and redo without a limit: each step is the one stretch of the text that it replaced.

const PAUSE = 900; // ms without a key after which typing becomes another step

export class History {
  constructor() { Object.assign(this, { steps: [], at: 0 }); }

  // A change of the text; keys typed one after the other make one step.
  add(before, after, words, { typed = false, selected = "", then = "" } = {}) {
    if (before === after) return;
    const [at, removed, inserted] = stretch(before, after);
    const last = this.steps[this.at - 1], now = performance.now();
    this.steps.length = this.at;
    if (typed && last?.typed && now - last.time < PAUSE && this.at === this.steps.length && !removed && at === last.at + last.inserted.length) {
      Object.assign(last, { inserted: last.inserted + inserted, time: now });
      return;
    }
    this.steps.push({ at, removed, inserted, words, typed, selected, then, time: now });
    this.at = this.steps.length;
  }

  get undone() { return this.steps[this.at - 1]; }
  get redone() { return this.steps[this.at]; }

  // Returns the text before the last step, and the step.
  undo(text) {
    const step = this.undone;
    if (!step) return null;
    this.at -= 1;
    return { step, text: text.slice(0, step.at) + step.removed + text.slice(step.at + step.inserted.length) };
  }

  redo(text) {
    const step = this.redone;
    if (!step) return null;
    this.at += 1;
    return { step, text: text.slice(0, step.at) + step.inserted + text.slice(step.at + step.removed.length) };
  }
}

// [where, removed, inserted]
export function stretch(before, after) {
  const most = Math.min(before.length, after.length);
  let head = 0, tail = 0;
  while (head < most && before[head] === after[head]) head += 1;
  while (tail < most - head && before[before.length - 1 - tail] === after[after.length - 1 - tail]) tail += 1;
  return [head, before.slice(head, before.length - tail), after.slice(head, after.length - tail)];
}

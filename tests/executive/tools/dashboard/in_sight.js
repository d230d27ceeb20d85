() => {
  // What is wrong with the page as it stands: words cut off, things over each other, a stop out of reach, sideways scrolling.
  const problems = [];
  const name = (e) => e.id || e.className || e.tagName;
  const shown = (e) => e.offsetParent !== null && e.offsetWidth > 0 && e.checkVisibility({ visibilityProperty: true });
  if (document.documentElement.scrollWidth > innerWidth) problems.push(`the page scrolls sideways: ${document.documentElement.scrollWidth} of ${innerWidth} px`);
  const words = "#kind, #state, #clock, #safe-stop, #safe-stop-words, .alerts > *, .banner > *, .alerts b, .alerts span, .alerts small, .alerts button, .alerts a, #holder, #ack, #breaks, #viewers, .control button, #why, #why .verdict, .playback > button, .empty";
  for (const e of document.querySelectorAll(words)) {
    if (!shown(e)) continue;
    const box = e.getBoundingClientRect();
    if (getComputedStyle(e).display !== "inline" && (e.scrollWidth > e.clientWidth + 1 || e.scrollHeight > e.clientHeight + 1)) problems.push(`${name(e)}: ${e.clientWidth} × ${e.clientHeight} of ${e.scrollWidth} × ${e.scrollHeight} px shown: ${e.textContent.trim().slice(0, 60)}`);
    if (box.left < -1 || box.right > innerWidth + 1) problems.push(`${name(e)} is out of the window: ${box.left.toFixed(0)} to ${box.right.toFixed(0)}`);
    if (e.closest("header, .alerts, .why") && (box.top < -1 || box.bottom > innerHeight + 1)) problems.push(`${name(e)} is out of sight: ${box.top.toFixed(0)} to ${box.bottom.toFixed(0)} of ${innerHeight}`);
  }
  const groups = ["header > *", ".alerts > *, header, .control, main, .timeline-panel", ".alerts .bar > *", ".latched > *", ".why > *", ".question > *", ".control > *, #live-control > *", "#run-view > .panel, .middle > .panel, .below > .panel", ".middle > .panel > *, .below > .panel > *", ".playback > *", ".runs-view > .panel"];
  for (const group of groups) {
    const boxes = [...document.querySelectorAll(group)].filter(shown).map((e) => [e, e.getBoundingClientRect()]);
    for (const [i, [one, a]] of boxes.entries()) for (const [other, b] of boxes.slice(i + 1)) {
      if (one.contains(other) || other.contains(one) || getComputedStyle(one).position === "sticky" || getComputedStyle(other).position === "sticky") continue;
      if (one.matches(".handle") || other.matches(".handle")) continue;
      const [wide, high] = [Math.min(a.right, b.right) - Math.max(a.left, b.left), Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top)];
      if (wide > 1 && high > 1) problems.push(`${name(one)} and ${name(other)} overlap by ${wide.toFixed(0)} × ${high.toFixed(0)} px`);
    }
  }
  const stop = document.getElementById("safe-stop"), at = stop.getBoundingClientRect();
  const top = document.elementFromPoint(at.left + at.width / 2, at.top + at.height / 2);
  if (at.height < 30 || !stop.contains(top)) problems.push(`SAFE STOP cannot be pressed: ${top && name(top)} lies there`);
  return problems;
}

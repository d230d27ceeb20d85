async ({ reasons, nodes, drawn }) => {
    // Feeds failed runs to the open page, one after the other, and measures whether each reason is wholly in sight. The
    // first `drawn` of them are drawn by the page in its own time, tree and all; of the others the reason alone.
    const { page } = await import("/static/page.js");
    const { drawWhy } = await import("/static/panels.js");
    const { apply, emptyState } = await import("/static/store.js");
    const next = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    const frame = async () => { do await next(); while (page.dirty || page.drawing); };
    const entries = nodes.map((name, i) => ({ path: `t/${i}`, parent: i ? "t/0" : null, kind: "skill", type: name, name, line: 1 }));
    const problems = [];
    for (const [number, { code, message, data }] of reasons.entries()) {
      const leaf = { node_path: "t/39", code, message, data, causes: [] };
      const gaveUp = `gave up after attempt 1 of 8; the last: ${message}`;
      const reason = { node_path: "t/0", code, message: `all 3 attempts failed; the last: ${gaveUp}`, data: {}, causes: [0, 1, 2].map((n) => ({ node_path: "t/1", code, message: gaveUp, data: {}, causes: [leaf] })) };
      const s = emptyState(), words = message.replace(/[.\s]*$/, "");
      apply(s, { event: "RunStarted", seq: 1, t: 0, tick: 0, run: `r${number}`, tree: "pick", seed: 0, cell: "sim", cell_kind: "simulated", nodes: entries });
      apply(s, { event: "NodeChanged", seq: 2, t: 1, tick: 50, path: "t/39", status: "RUNNING", starts: 1, feedback: "" });
      apply(s, { event: "NodeChanged", seq: 3, t: 2, tick: 100, path: "t/39", status: "FAILURE", starts: 1, feedback: "", reason: leaf });
      apply(s, { event: "RunEnded", seq: 4, t: 2, tick: 100, outcome: "failure", reason, ticks: 100, time: 2, wall: 2 });
      page.live.whole = s;
      page.dirty = true;
      if (number < drawn) await frame(); else drawWhy(s);
      const say = (what) => problems.push(`${code} (${message.length} characters): ${what}`);
      const why = document.querySelector(".why"), box = why.getBoundingClientRect();
      const shown = document.getElementById("why").textContent;
      if (!shown.includes(code) || !shown.includes(words)) say(`the words are not there: ${shown}`);
      if (shown.indexOf("gave up") >= 0 && shown.indexOf("gave up") < shown.indexOf(words)) say("what led to it stands first");
      if (why.scrollHeight > why.clientHeight + 1 || why.scrollWidth > why.clientWidth + 1) say(`${why.clientHeight} of ${why.scrollHeight} px shown`);
      if (box.bottom > innerHeight + 1 || box.top < 0) say(`out of the window: ${box.top} to ${box.bottom}`);
      if (document.documentElement.scrollWidth > innerWidth) say("the page scrolls sideways");
      const lines = (of) => { const text = document.createRange(); text.selectNodeContents(of); return text.getClientRects().length; };
      for (const name of why.querySelectorAll(".data dt")) if (lines(name) > 2) say(`'${name.textContent}' stands letter by letter`);
      if (number >= drawn) continue;
      const boxes = [...document.querySelectorAll("header > *, .bar, .control > *, #run-view > .panel, .middle > .panel, .below > .panel, .timeline-panel")].filter((e) => e.offsetParent && e.offsetWidth && e.textContent.trim()).map((e) => [e.id || e.className, e.getBoundingClientRect()]);
      for (const [i, [name, a]] of boxes.entries()) for (const [other, b] of boxes.slice(i + 1)) {
        if (innerWidth > 720 && a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1 && a.bottom <= innerHeight + 1 && b.bottom <= innerHeight + 1) say(`${name} and ${other} overlap`);
      }
      const row = document.querySelector('.row[data-path="t/39"]'), [r, tree] = [row, document.getElementById("tree")].map((e) => e.getBoundingClientRect());
      if (!row.classList.contains("selected") || r.top < tree.top - 1 || r.bottom > tree.bottom + 1) say("the failed leaf is not in sight in the tree");
    }
    return problems;
}

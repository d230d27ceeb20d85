async () => {
    // The events of a stop between two skills: the second is refused before the stop is reported.
    const { page } = await import("/static/page.js");
    const { apply } = await import("/static/store.js");
    const nodes = ["t", "t/Feel", "t/Lift"].map((path, i) => ({ path, parent: i ? "t" : null, kind: "skill", type: path, name: path.slice(2) || path }));
    const change = (path, status, tick) => ({ event: "NodeChanged", t: tick / 50, tick, path, status, starts: 1, feedback: "" });
    const reason = { node_path: "", code: "SAFE_STOP", message: "safe stop by ada", data: {}, causes: [] };
    for (const m of [
      { event: "RunStarted", seq: 1, t: 0, tick: 0, run: "r", tree: "t", seed: 0, cell: "sim", cell_kind: "simulated", nodes },
      change("t", "RUNNING", 1), change("t/Feel", "RUNNING", 1), change("t/Feel", "FAILURE", 5), change("t/Feel", "SUCCESS", 9),
      change("t/Lift", "FAILURE", 9),
      { event: "OperatorActed", t: 0.18, tick: 9, who: "ada", action: "safe_stop", detail: "" },
      { event: "SafeStopped", t: 0.18, tick: 9, reason: "safe stop by ada" },
      change("t/Feel", "INVALID", 9), change("t/Lift", "INVALID", 9),
      { event: "RunEnded", t: 0.18, tick: 9, outcome: "stopped", reason, ticks: 9, time: 0.18, wall: 1 },
    ]) apply(page.live.whole, m);
    page.dirty = true;
}

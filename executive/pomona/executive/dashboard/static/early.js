// Before the rest of the page is there: the overview of the record that the address names, which takes the server a while.
{
  const fields = new URLSearchParams(location.hash.slice(1)), run = fields.get("run");
  const token = fields.get("token") || sessionStorage.getItem("pomona-token");
  if (run) {
    document.documentElement.classList.add("opens-record"); // until it is drawn its bar alone is shown: nothing moves under the eye
    const answer = fetch(`api/runs/${encodeURIComponent(run)}/messages?overview`, { headers: token ? { "x-pomona-token": token } : {} });
    answer.catch(() => {}); // whoever reads it hears of it
    window.early = { run, answer };
  }
}

// Requests the overview of the record in the address before the other scripts load, since the server takes a while.
{
  const fields = new URLSearchParams(location.hash.slice(1)), run = fields.get("run");
  const token = fields.get("token") || sessionStorage.getItem("pomona-token");
  if (run) {
    document.documentElement.classList.add("opens-record"); // until it is drawn only its bar is shown, so that the layout does not shift
    const answer = fetch(`api/runs/${encodeURIComponent(run)}/messages?overview`, { headers: token ? { "x-pomona-token": token } : {} });
    answer.catch(() => {}); // the reader handles the error
    window.early = { run, answer };
  }
}

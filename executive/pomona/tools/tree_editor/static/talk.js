// Requests to the editor's own server.

const fields = new URLSearchParams(location.hash.slice(1));
if (fields.has("token")) {
  sessionStorage.setItem("pomona-editor-token", fields.get("token"));
  history.replaceState(null, "", location.pathname); // the token stands behind the '#', which no server sees, and is not shared with the address
}
const token = sessionStorage.getItem("pomona-editor-token") ?? "";
export const mayAct = Boolean(token);

// This page; after a reload it is the same one, so that it finds its draft again.
export const me = sessionStorage.getItem("pomona-editor-page") ?? crypto.getRandomValues(new Uint32Array(3)).join("-");
sessionStorage.setItem("pomona-editor-page", me);

const here = (path, asked = {}) => {
  const url = new URL(path, location.href.split("#")[0]);
  for (const [name, value] of Object.entries(asked)) url.searchParams.set(name, value);
  return url;
};

async function answer(request) {
  try {
    const response = await request;
    const content = await response.json();
    return { ...content, status: response.status };
  } catch { return { error: "the editor's program does not answer: is it still running?", status: 0 }; }
}

export const get = (path, asked) => answer(fetch(here(`api/${path}`, asked), { headers: { "x-pomona-token": token }, signal: AbortSignal.timeout(20000) }));

export const post = (path, body, keepalive = false) => answer(fetch(here(`api/${path}`), {
  method: "POST", keepalive, headers: { "content-type": "application/json", "x-pomona-token": token }, body: JSON.stringify({ page: me, ...body }),
}));

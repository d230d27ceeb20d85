// The smallest DOM builder: text is always text, never markup.

export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "class") element.className = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  for (const child of children.flat()) {
    if (child === null || child === undefined || child === false) continue;
    element.append(child instanceof Node ? child : String(child));
  }
  return element;
}

export const $ = (id) => document.getElementById(id);

// A text that is there already stays: to write it again would make the browser lay the page out.
export const put = (element, text) => { if (element.textContent !== text) element.textContent = text; };

export function seconds(value) {
  if (value < 0.0995) return `${(value * 1000).toFixed(0)} ms`;
  if (value < 59.95) return `${value.toFixed(1)} s`;
  const whole = Math.round(value);
  return `${Math.floor(whole / 60)} min ${whole % 60} s`;
}

export function show(value, depth = 0) {
  if (value === null || value === undefined) return "–";
  if (typeof value === "number") return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(5)));
  if (Array.isArray(value)) {
    const inner = value.slice(0, 16).map((v) => show(v, depth + 1)).join(", ");
    return `[${inner}${value.length > 16 ? ", …" : ""}]`;
  }
  if (typeof value === "object") {
    if (value.array) return value.array;
    const entries = Object.entries(value).filter(([k]) => k !== "type");
    const inner = entries.map(([k, v]) => `${k}: ${depth > 1 ? "…" : show(v, depth + 1)}`).join("\n");
    return (value.type ? `${value.type}\n` : "") + inner;
  }
  return String(value);
}

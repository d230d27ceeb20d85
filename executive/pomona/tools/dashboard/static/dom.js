// The smallest DOM builder: text is always text, never markup.

export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "class") element.className = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  for (const child of children.flat(Infinity)) {
    if (child === null || child === undefined || child === false) continue;
    element.append(child instanceof Node ? child : String(child));
  }
  return element;
}

export const $ = (id) => document.getElementById(id);

// Write a text only if it differs: writing it again would make the browser lay the page out.
export const put = (element, text) => { if (element.textContent !== text) element.textContent = text; };

export function seconds(value) {
  if (value < 0.0995) return `${(value * 1000).toFixed(0)} ms`;
  if (value < 59.95) return `${value.toFixed(1)} s`;
  const whole = Math.round(value);
  return `${Math.floor(whole / 60)} min ${whole % 60} s`;
}

export const percent = (text) => text.replace(/(\d)%/g, "$1 %");

const figure = (value, digits = 3) => String(Number(value.toPrecision(digits)));
const UNIT = { // formats by the unit at the end of a name
  m: (v) => (Math.abs(v) < 1 ? `${figure(1e3 * v)} mm` : `${figure(v)} m`), mm: (v) => `${figure(v)} mm`, px: (v) => `${figure(v)} px`,
  s: (v) => (v < 0 ? `${figure(v)} s` : seconds(v)), n: (v) => `${figure(v)} N`, nm: (v) => `${figure(v)} N m`, hz: (v) => `${figure(v)} Hz`,
  kg: (v) => (Math.abs(v) < 1 ? `${figure(1e3 * v)} g` : `${figure(v)} kg`), rad: (v) => `${figure((v * 180) / Math.PI)}°`, deg: (v) => `${figure(v)}°`,
  m_s: (v) => `${figure(1e3 * v)} mm/s`, rad_s: (v) => `${figure((v * 180) / Math.PI)}°/s`, m_s2: (v) => `${figure(v)} m/s²`,
};

// Name and formatted value: ["width", "79.7 mm"] of width_m and 0.07974.
export function quantity(name, value, depth = 0) {
  const [, bare, unit] = name.match(/^(.+?)_(m_s2|m_s|rad_s|mm|nm|px|hz|kg|rad|deg|m|s|n)$/) ?? [];
  const told = (v) => (typeof v === "number" ? UNIT[unit](v) : v === null ? "–" : null);
  const text = !unit ? null : Array.isArray(value) ? (value.length < 8 && value.every((v) => told(v)) ? value.map(told).join(", ") : null) : told(value);
  return text === null ? [name.replaceAll("_", " "), show(value, depth)] : [bare.replaceAll("_", " "), text];
}

export function show(value, depth = 0) {
  if (value === null || value === undefined) return "–";
  if (typeof value === "number") return Number.isInteger(value) ? String(value) : figure(value, Math.abs(value) < 1 ? 3 : 5);
  if (Array.isArray(value)) {
    const inner = value.slice(0, 16).map((v) => show(v, depth + 1)).join(", ");
    return `[${inner}${value.length > 16 ? ", …" : ""}]`;
  }
  if (typeof value === "object") {
    if (value.array) return value.array;
    const entries = Object.entries(value).filter(([k]) => k !== "type");
    const inner = entries.map(([k, v]) => (depth > 1 ? `${k}: …` : quantity(k, v, depth + 1).join(": "))).join("\n");
    return (value.type ? `${value.type}\n` : "") + inner;
  }
  return String(value);
}

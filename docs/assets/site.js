// What the theme's script makes and leaves without a name or out of the keyboard's reach: copy buttons, wide tables.
const mend = () => {
  document.querySelectorAll(".md-code__nav:not([aria-label])").forEach((nav, n) => nav.setAttribute("aria-label", `tools of code block ${n + 1}`));
  document.querySelectorAll(".md-typeset__scrollwrap:not([tabindex])").forEach((wrap) => wrap.setAttribute("tabindex", "0"));
};
new MutationObserver(mend).observe(document.documentElement, { childList: true, subtree: true });
mend();

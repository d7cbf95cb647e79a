// The theme puts a landmark around each code's buttons, all of one name, which get numbers; code that scrolls can be
// reached by the keyboard before it has been seen, too, and whatever the theme's own measure says of it.
const mend = () => {
  document.querySelectorAll(".md-code__nav:not([aria-label^='Code'])").forEach(nav => nav.setAttribute("aria-label", `Code ${nav.parentElement.id}`));
  for (const code of document.querySelectorAll("pre > code:not([tabindex])"))
    if (code.scrollWidth > code.clientWidth || code.scrollHeight > code.clientHeight) code.tabIndex = 0;
};
new MutationObserver(mend).observe(document.body, { childList: true, subtree: true, attributeFilter: ["tabindex"] });
new ResizeObserver(mend).observe(document.body);

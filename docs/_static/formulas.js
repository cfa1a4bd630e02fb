"use strict";
// Mark the inline formulas that are wider than their paragraph: each has its own scroll bar.
const marked = () => {
  for (const one of document.querySelectorAll("mjx-container:not([display])")) {
    one.classList.remove("wide");
    const block = one.closest("p, li, dd, td, th, summary, h1, h2, h3");
    if (block && one.getBoundingClientRect().width > block.clientWidth) one.classList.add("wide");
  }
};
addEventListener("load", () => window.MathJax?.startup?.promise.then(marked));
addEventListener("resize", marked);
// Mark the pictures of two panels side by side: narrow windows scroll them, and cards show the left panel.
addEventListener("load", () => {
  for (const one of document.querySelectorAll("article img"))
    one.classList.toggle("wide", one.naturalWidth > 1.9 * one.naturalHeight);
});
document.addEventListener("toggle", marked, true); // an answer has no width before it is open

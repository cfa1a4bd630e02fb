"use strict";
// The keys right and left show the next and the previous slide, and "a" opens and closes answers. The browser handles
// space, page keys and the key down. The slide that is shown has the focus, so that the next tab stop is on it.
const slides = [...document.querySelectorAll("main > section")];
const shown = () => {
  const middle = window.innerHeight / 2;
  return Math.max(slides.findIndex((one) => one.getBoundingClientRect().bottom > middle), 0);
};
const focused = (slide) => {
  if (!slide.contains(document.activeElement)) slide.focus({ preventScroll: true });
};
document.addEventListener("keydown", (event) => {
  if (event.altKey || event.ctrlKey || event.metaKey) return;
  const way = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (way) {
    const next = slides[Math.min(Math.max(shown() + way, 0), slides.length - 1)];
    next.scrollIntoView();
    focused(next);
  } else if (event.key === "a") {
    const answers = [...slides[shown()].querySelectorAll("details:not(.hide)")];
    const closed = answers.some((one) => !one.open);
    for (const one of answers) one.open = closed;
    if (closed) answers.at(-1)?.scrollIntoView({ block: "nearest" });
  } else return;
  event.preventDefault();
});
addEventListener("scrollend", () => focused(slides[shown()]));
document.addEventListener("focusin", (event) => {
  const slide = event.target.closest("main > section");
  if (slide && slide.clientHeight <= window.innerHeight) slide.scrollIntoView();
});

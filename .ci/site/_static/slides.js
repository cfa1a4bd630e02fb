"use strict";
// Arrows to the sides go on and back; space, page keys and arrows down are the browser's own.
document.addEventListener("keydown", (event) => {
  const way = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!way || event.altKey || event.ctrlKey || event.metaKey) return;
  const slides = [...document.querySelectorAll("main > section")];
  const middle = window.innerHeight / 2;
  const here = slides.findIndex((one) => one.getBoundingClientRect().bottom > middle);
  slides[Math.min(Math.max(here + way, 0), slides.length - 1)].scrollIntoView();
  event.preventDefault();
});

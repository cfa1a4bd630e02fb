"""Web pages in a headless Chromium: its window, and a search for text with too little contrast."""

from __future__ import annotations

import shutil
from contextlib import contextmanager

import pytest

FLAGS = (
    "headless no-sandbox disable-gpu disable-quic no-first-run disable-dev-shm-usage disable-sync "
    "disable-background-networking disable-component-update window-size=1440,1000"
)
FAINT = """
const channel = (c) => (c /= 255, c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
const parsed = (colour) => {
  const canvas = parsed.canvas ??= new OffscreenCanvas(1, 1).getContext('2d', {willReadFrequently: true});
  canvas.clearRect(0, 0, 1, 1); canvas.fillStyle = colour; canvas.fillRect(0, 0, 1, 1);
  const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
  return [r, g, b, a / 255];
};
const over = (top, below) => [0, 1, 2].map((k) => top[3] * top[k] + (1 - top[3]) * below[k]);
const behind = (element) => {
  const layers = [];
  for (let one = element; one; one = one.parentElement) layers.push(parsed(getComputedStyle(one).backgroundColor));
  return layers.reverse().reduce((below, top) => over(top, below), [255, 255, 255]);
};
const light = (rgb) => 0.2126 * channel(rgb[0]) + 0.7152 * channel(rgb[1]) + 0.0722 * channel(rgb[2]);
const faint = {};
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
for (let node; (node = walker.nextNode());) {
  const element = node.parentElement;
  if (!node.data.trim() || !element.checkVisibility({visibilityProperty: true, opacityProperty: true})) continue;
  if (element.closest('svg, mjx-container, script, style, noscript')) continue;
  const style = getComputedStyle(element), size = parseFloat(style.fontSize);
  const ground = behind(element), ink = over(parsed(style.color), ground);
  const [dark, bright] = [light(ink), light(ground)].sort((a, b) => a - b);
  const ratio = (bright + 0.05) / (dark + 0.05);
  const large = size >= 24 || (size >= 18.66 && style.fontWeight >= 700);
  const what = `${element.tagName} ${element.className} ${style.color} ${ratio.toFixed(2)}`;
  if (ratio < (large ? 3 : 4.5) - 0.005) faint[what] = node.data.trim().slice(0, 40);
}
return Object.entries(faint).slice(0, 20);
"""
"""Script that returns texts with a contrast below WCAG 2.1, level AA (1.4.3): 4.5, or 3 for large letters."""


@contextmanager
def start_browser(folder):
    """Start a headless Chromium that logs its requests; skip the test if it is not installed."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="the browser is driven by selenium")
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        pytest.skip("there is no chromium or no chromedriver here")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for word in (*FLAGS.split(), f"user-data-dir={folder / 'chromium'}"):
        options.add_argument(f"--{word}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driven = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    try:
        yield driven
    finally:
        driven.quit()


def set_window(browser, width, theme):
    """Set the width of the window in pixels, and the theme, "light" or "dark"."""
    size = {"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    prefers = [{"name": "prefers-color-scheme", "value": theme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": prefers})

"""Start a headless Chromium, and set the size of its window."""

from __future__ import annotations

import shutil
from contextlib import contextmanager

import pytest

FLAGS = (
    "headless no-sandbox disable-gpu disable-quic no-first-run disable-dev-shm-usage disable-sync "
    "disable-background-networking disable-component-update window-size=1440,1000"
)


@contextmanager
def start_browser(folder):
    """Start a headless Chromium that logs requests, or skip the test."""
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


def set_window(browser, width):
    """Set the width of the window in pixels."""
    size = {"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)

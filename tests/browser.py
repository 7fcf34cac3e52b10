"""A page in headless Chromium, asked over its DevTools protocol: what it shows, with real pointers, keys and files."""

import base64
import contextlib
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from urllib.request import urlopen

import websocket

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
OPTIONS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-dev-shm-usage"),
    *("--disable-extensions", "--disable-background-networking", "--hide-scrollbars"),
    *("--remote-debugging-port=0", "--remote-allow-origins=*"),
)
PATIENCE_S = 120  # a busy machine is no fault
_KEYS = {" ": "Space", "ArrowLeft": "ArrowLeft", "ArrowRight": "ArrowRight", "ArrowUp": "ArrowUp", "Escape": "Escape"}
_CODES = {
    " ": 32,
    "ArrowLeft": 37,
    "ArrowUp": 38,
    "ArrowRight": 39,
    "ArrowDown": 40,
    "Escape": 27,
    "Tab": 9,
    "Enter": 13,
}


class Page:
    """One page of one browser; `faults` are its errors and warnings, `asked` what it wanted from a network.

    What the browser writes is in a folder of its own, `home`, which goes with it: short, since a socket lies in it.
    """

    def __init__(self, path, width=1280, height=850, dark=False, phone=False):
        self.faults, self.asked, self._number = [], [], 0
        self._folder = tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True)
        self.home = Path(self._folder.name)
        profile = self.home / "profile"
        self._browser = subprocess.Popen(
            [CHROMIUM, *OPTIONS, f"--user-data-dir={profile}", "about:blank"],
            env=os.environ | dict.fromkeys(("TMPDIR", "HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"), str(self.home)),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        port_file = profile / "DevToolsActivePort"
        self._wait(lambda: port_file.exists() and port_file.read_text().strip(), "the browser does not start")
        port = port_file.read_text().split()[0]
        pages = json.load(urlopen(f"http://127.0.0.1:{port}/json/list"))
        address = next(one for one in pages if one["type"] == "page")["webSocketDebuggerUrl"]
        self._socket = websocket.create_connection(address, timeout=PATIENCE_S, suppress_origin=True)
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=2 if phone else 1,
            mobile=phone,
        )
        self.send("Emulation.setTouchEmulationEnabled", enabled=phone)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", features=[scheme])
        self.send("Page.navigate", url=Path(path).resolve().as_uri())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._socket.close()
        self._browser.terminate()
        try:
            self._browser.wait(20)
        except subprocess.TimeoutExpired:
            self._browser.kill()
            self._browser.wait()
        with contextlib.suppress(ProcessLookupError):  # its children, which write until they end
            os.killpg(self._browser.pid, signal.SIGKILL)
        self._folder.cleanup()

    def send(self, method, **params):
        """The answer to one command; events that come before it are noted."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": params}))
        while True:
            said = json.loads(self._socket.recv())
            if said.get("id") == self._number:
                assert "error" not in said, f"{method}: {said['error']}"
                return said["result"]
            self._note(said.get("method"), said.get("params", {}))

    def _note(self, event, params):
        if event == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.faults.append(details.get("exception", {}).get("description", details["text"]))
        elif event == "Runtime.consoleAPICalled" and params["type"] in {"error", "warning", "assert"}:
            self.faults.append(str([one.get("value", one.get("description")) for one in params["args"]]))
        elif event == "Log.entryAdded" and params["entry"]["level"] in {"error", "warning"}:
            self.faults.append(params["entry"]["text"])
        elif event == "Network.requestWillBeSent":
            self.asked.append(params["request"]["url"][:200])

    def ask(self, expression):
        """What a JavaScript expression is, promises awaited."""
        found = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, f"{expression}: {found.get('exceptionDetails')}"
        return found["result"].get("value")

    def until(self, expression):
        """Wait for an expression to hold."""
        self._wait(lambda: self.ask(expression), f"it never came true: {expression}")

    def _wait(self, holds, otherwise):
        ends = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < ends and self._browser.poll() is None, otherwise
            time.sleep(0.1)

    def drawn(self):
        """After the next frames have been drawn."""
        self.ask("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 0))))")

    def pixels(self, selector):
        """What a canvas shows, as a text that is another one where any pixel is."""
        self.drawn()
        return self.ask(f"document.querySelector({json.dumps(selector)}).toDataURL()")

    def box(self, selector):
        """Left, top, width and height of an element within the window, once it is scrolled to."""
        return self.ask(f"""(() => {{
            const one = document.querySelector({json.dumps(selector)});
            one.scrollIntoView({{block: "center"}});
            const box = one.getBoundingClientRect();
            return [box.left, box.top, box.width, box.height];
        }})()""")

    def set(self, selector, value, event="change"):
        """Give an input or a choice a value, as a hand would: the value, then the event."""
        self.ask(f"""(() => {{
            const one = document.querySelector({json.dumps(selector)});
            one.value = {json.dumps(value)};
            one.dispatchEvent(new Event({json.dumps(event)}));
        }})()""")
        self.drawn()

    def click(self, selector):
        """Press an element, wherever it is."""
        self.ask(f"document.querySelector({json.dumps(selector)}).click()")
        self.drawn()

    def text(self, selector):
        """The words of an element."""
        return self.ask(f"document.querySelector({json.dumps(selector)}).textContent")

    def point(self, selector, x=0.5, y=0.5, press=True):
        """Move the pointer to a share of an element's width and height, and press."""
        left, top, width, height = self.box(selector)
        at = {"x": left + x * width, "y": top + y * height}
        self.send("Input.dispatchMouseEvent", type="mouseMoved", **at)
        if press:
            for kind in ("mousePressed", "mouseReleased"):
                self.send("Input.dispatchMouseEvent", type=kind, button="left", buttons=1, clickCount=1, **at)
        self.drawn()

    def tap(self, selector, x=0.5, y=0.5):
        """Touch a share of an element's width and height."""
        left, top, width, height = self.box(selector)
        self.send(
            "Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": left + x * width, "y": top + y * height}]
        )
        self.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        self.drawn()

    def press(self, *keys):
        """Press keys one after the other, by their names."""
        for key in keys:
            code = _CODES.get(key, ord(key[0].upper()))
            what = {"key": key, "code": _KEYS.get(key, key), "windowsVirtualKeyCode": code}
            text = {"text": key} if len(key) == 1 else {"text": "\r"} if key == "Enter" else {}
            self.send("Input.dispatchKeyEvent", type="keyDown", **what, **text)
            self.send("Input.dispatchKeyEvent", type="keyUp", **what)
        self.drawn()

    def type(self, text):
        """Type a text where the focus is."""
        self.send("Input.insertText", text=text)
        self.drawn()

    def choose_file(self, selector, path):
        """Give a file to an input of files."""
        root = self.send("DOM.getDocument")["root"]["nodeId"]
        node = self.send("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.send("DOM.setFileInputFiles", nodeId=node, files=[str(Path(path).resolve())])

    def screenshot(self, path, whole=False):
        """A PNG of the window, or of the whole page."""
        self.drawn()
        Path(path).write_bytes(
            base64.b64decode(self.send("Page.captureScreenshot", captureBeyondViewport=whole, format="png", **(
                {"clip": {**self.send("Page.getLayoutMetrics")["cssContentSize"], "scale": 1}} if whole else {}
            ))["data"])
        )  # fmt: skip

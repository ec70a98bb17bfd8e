"""Opens the programs' pages in a real browser: no errors, something drawn, keyboard, dark, phone, and no WebGL.

Use: python pages.py PICTURES REPORT LOOP EVALUATION REGISTRATION TRAINING      (called by .ci/pages)
Needs Chromium and playwright. Writes the pictures that the README shows into PICTURES.
"""

import pathlib
import sys

from playwright.sync_api import sync_playwright

SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
# Different colours in the canvas; a blank one has one.
COLORS = """() => { const c = document.querySelector('canvas'), gl = c.getContext('webgl'), p = new Uint8Array(4 * c.width * c.height);
  gl.readPixels(0, 0, c.width, c.height, gl.RGBA, gl.UNSIGNED_BYTE, p);
  const seen = new Set(); for (let i = 0; i < p.length; i += 4) seen.add(p[i] << 16 | p[i + 1] << 8 | p[i + 2]); return seen.size; }"""

# The view whose scan failed to register.
FAILED = "const f = document.getElementById('step'); f.value = DATA.failed.indexOf(true) + 1; f.oninput()"


def main(pictures, report, loop, evaluation, registration, training):
    pictures = pathlib.Path(pictures)
    pages = {"report": report, "loop": loop, "evaluation": evaluation, "registration": registration, "training": training}
    failures = []

    def check(holds, what):
        print("ok  " if holds else "FAIL", what)
        if not holds:
            failures.append(what)

    with sync_playwright() as p:
        def launch(*flags):
            return p.chromium.launch(executable_path=CHROMIUM, args=[*SOFTWARE, *flags])

        browser = launch()
        for name, path in pages.items():
            for scheme, width in [("light", 1280), ("dark", 1280), ("light", 390)]:
                errors = []
                page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
                page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
                page.on("pageerror", lambda e: errors.append(str(e)))
                page.goto(pathlib.Path(path).absolute().as_uri())
                page.wait_for_timeout(400)
                what = f"{name}, {scheme}, {width} px"
                check(not errors, f"{what}: no errors {errors}")
                over = page.evaluate("document.documentElement.scrollWidth - innerWidth")
                check(over <= 0, f"{what}: fits the width ({over} px over)")
                canvas = page.query_selector("canvas")
                if canvas:
                    check(page.evaluate(COLORS) > 50, f"{what}: the canvas shows something")
                    before = page.screenshot()
                    canvas.focus()
                    for _ in range(5):
                        page.keyboard.press("ArrowRight")
                    check(page.screenshot() != before, f"{what}: arrow keys turn it")
                if name == "report":
                    chosen = "[...document.querySelectorAll('tr.row')].findIndex(r => r.className.includes('on'))"
                    was = page.evaluate(chosen)
                    page.keyboard.press("n")
                    check(page.evaluate(chosen) == was + 1, f"{what}: n chooses the next candidate")
                if name == "registration":
                    page.evaluate(FAILED)
                    check("failed, " in page.inner_text("#caption"), f"{what}: the failed scan is named as it comes")
                if name in ("loop", "evaluation", "registration"):
                    page.evaluate("const s = document.getElementById('step'); s.value = 1; s.oninput()")
                    check("1" in page.inner_text("#caption"), f"{what}: the slider goes back to the first view")
                page.close()
            page = browser.new_page(viewport={"width": 1280, "height": 760})
            page.goto(pathlib.Path(path).absolute().as_uri())
            if name == "registration":
                page.evaluate(FAILED)
            if name in ("evaluation", "registration"):
                page.evaluate("document.querySelector('canvas').scrollIntoView({block: 'center'})")
            page.wait_for_timeout(500)
            page.screenshot(path=pictures / f"{name}.png")
            page.close()
        browser.close()
        browser = launch("--disable-gpu", "--disable-3d-apis")
        for name in ("report", "evaluation"):
            page = browser.new_page()
            page.goto(pathlib.Path(pages[name]).absolute().as_uri())
            page.wait_for_timeout(200)
            check("no WebGL" in page.inner_text("body"), f"{name}, without WebGL: says so")
            page.close()
        browser.close()
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    import shutil

    CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if CHROMIUM is None:
        sys.exit("no Chromium: install the package chromium")
    main(*sys.argv[1:])

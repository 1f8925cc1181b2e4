"""The report: one file, no network, within its size, alive in a real browser."""

import base64
import json
import re
import shutil
import subprocess
import zlib

import numpy as np
import pytest
from PIL import Image

from jradar.outputs.page import CloudFrame, write_page

RNG = np.random.default_rng(0)
TABLE = "| a\\|b | CD |\n|---|---|\n| x<y | **0.5** |\n\n† a note"
SWITCHES = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync "
    "--virtual-time-budget=5000 --window-size=1200,1400 --enable-logging=stderr"
).split()


def cloud(points):
    return RNG.uniform([0, -3, -1], [9, 3, 2], size=(points, 3))


def frames(count, *, dense=3000):
    return [
        CloudFrame(
            f"run4, {i}",
            {"radar": cloud(100), "jradar": cloud(dense), "LiDAR": cloud(dense)},
            {"jradar": {"CD (m)": f"0.{i}"}},
        )
        for i in range(count)
    ]


def sure_frame(*, dense=3000):
    """A frame in which one cloud has confidence: eighths, as of eight draws."""
    confidence = RNG.integers(1, 9, size=(dense, 1)) / 8
    sure = np.hstack([cloud(dense), confidence])
    return CloudFrame("run4, 0", {"jradar": sure, "LiDAR": cloud(dense)})


def write(path, shown, **options):
    parts = {"title": "A </script> title", "tables": {"Table": TABLE}, "figures": {}}
    write_page(path, **{**parts, **options}, frames=shown)
    return path.read_text()


def data_of(text):
    found = re.search(r'<script id="data"[^>]*>(.*?)</script>', text, re.DOTALL)
    return json.loads(found[1])


def unpack(frame, unit=1e-3):
    """Clouds of a frame, read without the page's script."""
    raw = np.frombuffer(zlib.decompress(base64.b64decode(frame["data"])), np.uint8)
    start = 0
    for count, confident in zip(frame["drawn"], frame["confident"], strict=True):
        planes = raw[start : start + 6 * count].reshape(3, 2, count).astype(np.int64)
        xyz = (planes[:, 0] + 256 * planes[:, 1]).cumsum(1).astype(np.int16).T * unit
        start += 6 * count
        sure = raw[start : start + count] / 200
        yield np.column_stack([xyz, sure]) if confident else xyz
        start += count * confident
    assert start == len(raw)


def millimetres(points):
    """Places in whole millimetres, and confidence in half percents if there is one."""
    points = np.asarray(points)
    return {(*np.rint(1000 * p[:3]), *np.rint(200 * p[3:])) for p in points}


@pytest.mark.parametrize("shown", [frames(2), [sure_frame()]], ids=["plain", "sure"])
def test_clouds_come_out_to_the_millimetre(tmp_path, shown):
    data = data_of(write(tmp_path / "report.html", shown))
    assert data["names"] == [*shown[0].clouds]
    assert data["unit_m"] == 1e-3 and data["sure"] == 200
    for frame, original in zip(data["frames"], shown, strict=True):
        clouds = original.clouds.values()
        assert frame["confident"] == [xyz.shape[1] == 4 for xyz in clouds]
        for found, cloud in zip(unpack(frame), clouds, strict=True):
            assert millimetres(found) == millimetres(cloud)
    far = CloudFrame("far", {"LiDAR": np.array([[80.0, -79.0, 3.0], [1, 2, 3]])})
    data = data_of(write(tmp_path / "report.html", [far]))  # in a coarser unit
    (found,) = unpack(data["frames"][0], data["unit_m"])
    found = found[found[:, 0].argsort()]
    np.testing.assert_allclose(found, [[1, 2, 3], [80, -79, 3]], atol=data["unit_m"])


def test_clouds_are_thinned_to_the_limit_counted_and_keep_their_confidence(tmp_path):
    shown = [sure_frame(dense=9000), *frames(2, dense=9000)]
    text = write(tmp_path / "report.html", shown, max_bytes=150_000)
    assert 100_000 < len(text) <= 150_000
    data = data_of(text)
    first, frame, _ = data["frames"]
    assert data["names"] == ["jradar", "LiDAR", "radar"]
    assert frame["total"] == [9000, 9000, 100] and frame["drawn"][2] == 100
    assert 500 < frame["drawn"][0] == frame["drawn"][1] < 9000
    found, *_ = unpack(first)
    assert 500 < len(found) < 9000
    assert millimetres(found) <= millimetres(shown[0].clouds["jradar"])
    with pytest.raises(ValueError, match="leave out pictures or frames"):
        write(tmp_path / "report.html", frames(1), max_bytes=20_000)
    assert (tmp_path / "report.html").read_text() == text


def test_tables_and_pictures_are_inside_and_nothing_is_outside(tmp_path):
    Image.new("RGB", (4, 4)).save(tmp_path / "a.png")
    figures = {"one": tmp_path / "a.png", "a & b": tmp_path / "a.png"}
    text = write(tmp_path / "report.html", [], figures=figures)
    assert text.count("data:image/png;base64,") == 2 and 'alt="a &amp; b"' in text
    assert "<th>a|b</th>" in text and "<td>x&lt;y</td>" in text
    assert "<strong>0.5</strong>" in text and "† a note" in text
    assert "A &lt;/script&gt; title" in text and "</script> title" not in text
    assert "http:" not in text and "https:" not in text and "{{" not in text
    with pytest.raises(ValueError, match="expected a PNG"):
        (tmp_path / "x.png").write_bytes(b"JFIF")
        write(tmp_path / "report.html", [], figures={"x": tmp_path / "x.png"})


def test_a_page_opens_with_a_sentence_and_the_chosen_clouds(tmp_path):
    options = {"summary": "**jradar** is best", "opens_with": ["radar", "LiDAR"]}
    tables = {"Scores": TABLE, "Every score": TABLE}
    text = write(tmp_path / "report.html", frames(1), tables=tables, **options)
    assert text.index("<strong>jradar</strong> is best") < text.index('id="stage"')
    assert data_of(text)["shown"] == ["radar", "LiDAR"]
    assert "<details open><summary>Scores" in text
    assert "<details><summary>Every score" in text


@pytest.mark.usefixtures("as_a_user")
def test_bad_clouds_are_refused(tmp_path):
    for bad in (np.zeros((4, 2)), np.full((4, 3), np.nan), np.full((4, 4), 1.5)):
        with pytest.raises(ValueError, match="LiDAR"):
            write(tmp_path / "a.html", [CloudFrame("bad", {"LiDAR": bad})])
    assert not (tmp_path / "a.html").exists()


PROBE = """<script>
const after = (ms) => new Promise((done) => setTimeout(done, ms));
const sum = (plane) => plane.reduce((a, b) => a + b, 0);
const press = (key) => document.dispatchEvent(new KeyboardEvent("keydown", { key }));
const canvasEvent = (kind, name, options) => canvas.dispatchEvent(
  new kind(name, { pointerId: 1, buttons: 1, cancelable: true, ...options }));
const seen = {};
async function look(name) {
  await clouds(frame); await after(100);
  draw();  // a headless browser paints when it likes
  seen[name] = { frame: canvas.dataset.frame, points: Number(canvas.dataset.points),
    yaw: view.yaw, distance: view.distance, legend: find("legend").innerText };
}
(async () => {
  await look("start");
  press("ArrowRight"); await look("next");
  seen.sums = (await clouds(1)).map((c) => [sum(c.x), sum(c.y), sum(c.z)]);
  document.querySelector("#legend input").click(); await look("toggled");
  canvasEvent(WheelEvent, "wheel", { deltaY: -300 });
  fingers.set(1, { pointerId: 1, clientX: 0, clientY: 0 });
  canvasEvent(PointerEvent, "pointermove", { clientX: 100 }); await look("turned");
  reset();
  find("frame").value = 2; find("frame").oninput({ target: find("frame") });
  await look("slid");
  document.title = JSON.stringify(seen);
})();
</script></body>"""


SURE_PROBE = """<script>
const seen = { hidden: find("confidence").hidden };
seen.options = find("colour").options.length;
async function look(name, least, by) {
  find("least").value = least; find("least").oninput();
  find("colour").value = by; find("colour").onchange();
  draw();
  const kinds = new Set(new Int32Array(image.data.buffer));
  seen[name] = { points: Number(canvas.dataset.points), colours: kinds.size - 1,
    legend: find("legend").innerText, scale: find("scale").innerText,
    grey: kinds.has(grey) };
}
(async () => {
  const [first] = await clouds(0);
  seen.sure = first.sure ? first.sure.reduce((a, b) => a + b, 0) : 0;
  await show(0);
  await look("height", 0, "height"); await look("all", 0, "confidence");
  await look("half", 0.5, "confidence"); await look("most", 0.88, "confidence");
  document.title = JSON.stringify(seen);
})();
</script></body>"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    names = ("chromium", "chromium-browser", "google-chrome", "chrome")
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        pytest.skip(f"no browser here: none of {', '.join(names)}")

    def run(url, *switches):
        profile = tmp_path_factory.mktemp("profile")
        command = [found, *SWITCHES, f"--user-data-dir={profile}", *switches, url]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
        assert done.returncode == 0 and not console, done.stderr
        return done.stdout

    return run


def probed(path, browser, text, probe, address=""):
    """What the probe left in the page's title."""
    path.write_text(text.replace("</body>", probe))
    dom = browser(path.as_uri() + address, "--dump-dom")
    title = re.search(r"<title>(.*?)</title>", dom, re.DOTALL)[1]
    return json.loads(title.replace("&lt;", "<").replace("&amp;", "&"))


def test_the_page_lives_in_a_browser(tmp_path, browser):
    shown = frames(3)
    text = write(tmp_path / "report.html", shown, title="probe")
    seen = probed(tmp_path / "report.html", browser, text, PROBE)
    start, turned = seen["start"], seen["turned"]
    assert start["frame"] == "0" and "3,000" in start["legend"]
    assert 5000 < start["points"] <= 6100
    assert seen["next"]["frame"] == "1" and "0.1" in seen["next"]["legend"]
    assert seen["toggled"]["points"] == seen["next"]["points"] - 100
    assert turned["yaw"] < start["yaw"] - 0.3
    assert turned["distance"] < 0.8 * start["distance"]
    assert seen["slid"]["frame"] == "2" and seen["slid"]["yaw"] == start["yaw"]
    expected = [xyz.sum(0) for xyz in shown[1].clouds.values()]
    np.testing.assert_allclose(seen["sums"], expected, atol=0.5)


def test_a_browser_colours_by_confidence_and_hides_unsure_points(tmp_path, browser):
    path, frame = tmp_path / "report.html", sure_frame()
    text = write(path, [frame], title="probe")
    seen = probed(path, browser, text, SURE_PROBE, "#hide=LiDAR")
    sure = frame.clouds["jradar"][:, 3]
    assert not seen["hidden"] and seen["options"] == 3
    assert seen["sure"] == 200 * sure.sum()
    assert seen["all"]["colours"] == 8 < seen["height"]["colours"]
    assert " m" in seen["height"]["scale"] and " m" not in seen["all"]["scale"]
    assert 2900 < seen["all"]["points"] <= 3000
    for name, least in (("half", 0.5), ("most", 0.88)):
        left = int((sure >= least).sum())
        assert left - 100 < seen[name]["points"] <= left
        assert f"{left:,} of 3,000" in seen[name]["legend"]
    assert seen["half"]["colours"] == 5 and seen["most"]["colours"] == 1
    seen = probed(path, browser, text, SURE_PROBE)  # with the LiDAR's cloud
    assert seen["all"]["grey"] and not seen["height"]["grey"]
    assert seen["most"]["points"] > 2900  # a cloud without confidence is never hidden
    text = write(path, frames(1), title="probe")
    seen = probed(path, browser, text, SURE_PROBE, "#colour=confidence")
    assert seen["hidden"] and seen["options"] == 2


def test_a_browser_opens_with_the_chosen_clouds_side_by_side(tmp_path, browser):
    probe = """<script>(async () => { await show(0); draw();
      const layout = find("layout").value, points = Number(canvas.dataset.points);
      document.title = JSON.stringify({ layout, points }); })();</script></body>"""
    path, shown = tmp_path / "report.html", ["radar", "LiDAR"]
    text = write(path, frames(1), title="probe", opens_with=shown)
    seen = probed(path, browser, text, probe)
    assert seen["layout"] == "side" and 2500 < seen["points"] <= 3100
    seen = probed(path, browser, text, probe, "#hide=LiDAR&layout=together")
    assert seen["layout"] == "together" and 2500 < seen["points"] <= 3100
    text = write(path, frames(1), title="probe")
    seen = probed(path, browser, text, probe)
    assert seen["layout"] == "together" and seen["points"] > 5000

"""Make the moving pictures of the documentation, docs/figures/{swarm,quads,station}.webp.

`python -m docs.extensions.moving_pictures swarm` draws three runs of the scenario paper-25 with seed 1, in process.
`python -m docs.extensions.moving_pictures quads` draws quadcopters in wind, in process, and prints the run's digest.
`python -m docs.extensions.moving_pictures station` films the station's page in Chromium during such a run.
"""

import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from PIL import Image, ImageDraw
from scipy.spatial.transform import Rotation
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import Select
from tests.support.station_page import Looking, browser

import deltaswarm
from deltaswarm_orchestrator.recording.scene import role_colour
from deltaswarm_studies.style import LEVELS

FIGURES = Path(__file__).parents[1] / "figures"

SEED = 1

MODES = ("decentralised", "hierarchical", "hybrid")
SWARM_BEGIN_S, SWARM_END_S, SWARM_EVERY_S = 300, 540, 2
"""The part of the runs that is shown, and the simulated time from frame to frame [s]."""
SWARM_IN = (9.0, 4.1)
MOST_HZ = 20.0
"""The rate of messages at the end of the scale below each panel."""

QUADS_KEYS = {
    "world.dynamics": "jsbsim",
    "world.wind_mps": 5.0,
    "world.gust_mps": 2.0,
    "world.heights_m": [6.0, 9.0, 12.0, 15.0, 18.0],
}
QUADS_BEGIN_S, QUADS_END_S = 600, 720
QUADS_TOP_M, QUADS_TIMES = 25.0, 6.0
"""The height of the box that is drawn, and by how much quadcopters are larger in it than they are."""

STATION_BEGIN_S, STATION_END_S, STATION_EVERY_S = 300, 480, 3
STATION_SPEED = 5
STATION_KEYS = {"run.duration_s": 900, "operator.probes.isa_every_s": 360}
STATION_PX = {"width": 1280, "height": 720}

MEMBERS = ("member", "orphan")


class Look(NamedTuple):
    """How agents of a role are drawn, and what the legend calls them."""

    label: str
    marker: str
    colour: str
    size: float


LOOKS = {
    "free": Look("searching", "^", "#ffffff", 26),
    "attending": Look("working at an event", "D", "#9a9a9a", 24),
    "member": Look("in a tree (lighter: deeper)", "o", LEVELS[2], 30),
    "root": Look("root of a tree", "s", LEVELS[0], 46),
}


class Swarm:
    """One swarm: its run, and the panel in which it is drawn."""

    def __init__(self, mode: str, axes: Axes, bar: Axes) -> None:
        keys = {"control.mode": mode, "run.duration_s": SWARM_END_S + 1}
        run = deltaswarm.run("paper-25", keys, seed=SEED, progress=False)
        self.poses, self.series = run.poses, run.series.set_index("time_s")
        self.events = run.events.fillna({"completed_s": np.inf})
        arena, agents = run.scenario["arena"], run.scenario["agents"]
        axes.set(xlim=(0, arena["width_m"]), ylim=(0, arena["height_m"]), aspect="equal", xticks=[], yticks=[])
        axes.set_title(mode, fontsize=13, fontweight="bold", pad=6)
        self.edges = LineCollection([], colors="#222222", linewidths=1.1, zorder=2)
        axes.add_collection(self.edges)
        diameter_m = 2 * agents["sensing_range_m"]
        pale: dict[str, Any] = {"facecolors": (LEVELS[0],), "alpha": 0.10, "zorder": 1}
        places: dict[str, Any] = {"units": "x", "offsets": np.empty((0, 2)), "offset_transform": axes.transData}
        self.reach = EllipseCollection(diameter_m, diameter_m, 0, **places, **pale)
        axes.add_collection(self.reach)
        edge: dict[str, Any] = {"edgecolors": "#000000", "linewidths": 0.7, "zorder": 3, "clip_on": False}
        self.agents = {
            role: axes.scatter([], [], look.size, look.colour, marker=look.marker, **edge)
            for role, look in LOOKS.items()
        }
        self.open = axes.scatter([], [], 11, "#000000", zorder=4, edgecolors="#ffffff", linewidths=0.5)
        bar.set(xlim=(0, MOST_HZ), ylim=(0, 1), xticks=[], yticks=[])
        bar.spines[:].set_color("#bbbbbb")
        (self.rate,) = bar.barh([0.5], [0.0], 1.0, color="#c8553d")
        self.text = bar.text(0.5, -0.35, "", transform=bar.transAxes, ha="center", va="top", fontsize=10.5)

    def show(self, time_s: int) -> None:
        """Draw the swarm as it was at a time."""
        times_s = self.poses["time_s"]
        bodies = self.poses[times_s == times_s[times_s <= time_s].max()]
        places = bodies.set_index("agent")[["x_m", "y_m"]]
        in_trees = bodies[bodies["role"].isin((*MEMBERS, "root"))]
        self.reach.set_offsets(in_trees[["x_m", "y_m"]].to_numpy())
        children = bodies[(bodies["role"] == "member") & bodies["parent"].isin(places.index)]
        lines = zip(children[["x_m", "y_m"]].to_numpy(), places.loc[children["parent"]].to_numpy(), strict=True)
        self.edges.set_segments(list(lines))
        drawn = bodies["role"].replace(dict.fromkeys(MEMBERS, "member"))
        drawn = drawn.where(drawn.isin(LOOKS), "free")
        for role, artist in self.agents.items():
            artist.set_offsets(bodies.loc[drawn == role, ["x_m", "y_m"]].to_numpy().reshape(-1, 2))
        levels = bodies.loc[drawn == "member", "level"].clip(1, len(LEVELS) - 1).astype(int)
        self.agents["member"].set_facecolor([LEVELS[level] for level in levels] or "none")
        is_open = (self.events["arrived_s"] <= time_s) & (self.events["completed_s"] > time_s)
        self.open.set_offsets(self.events.loc[is_open, ["x_m", "y_m"]].to_numpy())
        rate_hz = self.series["operator_rate_60s_hz"][time_s]
        self.rate.set_width(rate_hz)
        self.text.set_text(f"{rate_hz:.1f} messages/s to the operator")


def swarm_frames() -> list[Image.Image]:
    """Draw three swarms side by side, with the same events."""
    figure = Figure(figsize=SWARM_IN, dpi=100, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    width, left, gap = 0.31, 0.01, 0.025
    swarms = []
    for place, mode in enumerate(MODES):
        x = left + place * (width + gap)
        axes = figure.add_axes((x, 0.235, width, width * SWARM_IN[0] / SWARM_IN[1]))
        swarms.append(Swarm(mode, axes, figure.add_axes((x, 0.165, width, 0.03))))
    figure.legend(handles=legend(), loc="lower right", ncols=5, frameon=False, fontsize=10, handletextpad=0.2)
    clock = figure.text(0.012, 0.045, "", fontsize=11, va="center")
    frames = []
    for time_s in range(SWARM_BEGIN_S, SWARM_END_S, SWARM_EVERY_S):
        for swarm in swarms:
            swarm.show(time_s)
        clock.set_text(f"{time_s} s")
        canvas.draw()
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    return frames


def legend() -> list[Line2D]:
    return [
        Line2D([], [], ls="", marker=look.marker, mfc=look.colour, mec="#000000", mew=0.7, ms=7, label=look.label)
        for look in LOOKS.values()
    ] + [Line2D([], [], ls="", marker="o", color="#000000", ms=4, label="event")]


def quads_frames() -> list[Image.Image]:
    """Draw the swarm in the air: two crossed arms for each quadcopter, its shadow, trees, and events on the ground."""
    run = deltaswarm.run("paper-25", {**QUADS_KEYS, "run.duration_s": QUADS_END_S + 1}, seed=SEED, progress=False)
    print(f"paper-25, seed {SEED}, {QUADS_KEYS}, digest {run.digest}")
    arena, arm_m = run.scenario["arena"], QUADS_TIMES * run.scenario["world"]["radius_m"]
    crossed = np.array([[[1, 1, 0], [-1, -1, 0]], [[1, -1, 0], [-1, 1, 0]]]) * arm_m / np.sqrt(2)
    figure = Figure(figsize=(8.0, 4.6), dpi=100, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    axes: Any = figure.add_axes((-0.14, -0.17, 1.28, 1.42), projection="3d")
    axes.set(xlim=(0, arena["width_m"]), ylim=(0, arena["height_m"]), zlim=(0, QUADS_TOP_M), xticks=[], yticks=[])
    axes.set_box_aspect((1, 1, QUADS_TOP_M / arena["width_m"]), zoom=1.1)
    axes.view_init(elev=24, azim=-64)
    axes.set_zticks([0, 10, 20], ["0", "10", "20 m"], fontsize=8)
    clock = figure.text(0.012, 0.03, "", fontsize=11)
    wind = f"wind {QUADS_KEYS['world.wind_mps']:g} m/s, gusts {QUADS_KEYS['world.gust_mps']:g} m/s"
    figure.text(0.012, 0.94, rf"{wind}  $\longrightarrow$", fontsize=11)
    signs = [
        Line2D([], [], color=role_colour(role), lw=2, label=look.label.split(" (")[0]) for role, look in LOOKS.items()
    ]
    event = Line2D([], [], ls="", marker="o", color="#000000", ms=4, label="event")
    figure.legend(handles=[*signs, event], loc="lower right", ncols=5, frameon=False, fontsize=8.5, handlelength=1)
    frames = []
    for time_s in range(QUADS_BEGIN_S, QUADS_END_S):
        times_s = run.poses["time_s"]
        bodies = run.poses[times_s == times_s[times_s <= time_s].max()].set_index("agent")
        places = bodies[["x_m", "y_m", "height_m"]]
        turns = Rotation.from_euler("ZYX", bodies[["heading_rad", "pitch_rad", "roll_rad"]] * [1, -1, 1])
        arms = np.concatenate([turn.apply(crossed.reshape(-1, 3)).reshape(2, 2, 3) for turn in turns])
        arms += np.repeat(places.to_numpy(), 2, axis=0)[:, None]
        children = bodies[bodies["parent"].isin(places.index)]
        colours = [role_colour("member" if role in MEMBERS else role) for role in bodies["role"]]
        edges = np.stack([places.loc[children.index], places.loc[children["parent"]]], axis=1)
        open_now = (run.events["arrived_s"] <= time_s) & ~(run.events["completed_s"] <= time_s)
        shown = [
            Line3DCollection(edges, colors="#999999", linewidths=1.0),
            Line3DCollection(arms, colors=np.repeat(colours, 2), linewidths=2.2),
        ]
        for lines in shown:
            axes.add_collection3d(lines, autolim=False)
        ground = {"zs": 0.0, "depthshade": False}
        shown += [
            axes.scatter(places["x_m"], places["y_m"], s=6, c="#cccccc", **ground),
            axes.scatter(*run.events.loc[open_now, ["x_m", "y_m"]].to_numpy().T, s=11, c="#000000", **ground),
        ]
        clock.set_text(f"{time_s} s")
        canvas.draw()
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
        for artist in shown:
            artist.remove()
    return frames


def station_frames() -> list[Image.Image]:
    """Film a person at the station who lowers delta and answers ISA."""
    with TemporaryDirectory() as folder, station(Path(folder)) as url, browser() as driver:
        driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride", STATION_PX | {"deviceScaleFactor": 1, "mobile": False}
        )
        driver.get(url)
        film = Film(Looking(driver))
        film.go_to_begin()
        film.take_until(316)
        film.page.at("argument-0").clear()
        film.page.at("argument-0").send_keys("2")
        film.take_until(320)
        film.click(film.page.at("command-send"))
        film.take_until(374)
        film.click(film.page.all("#isa-answers button")[2])
        film.take_until(STATION_END_S)
        return film.frames


class Film:
    """A page, and the frames that are taken of it."""

    def __init__(self, page: Looking) -> None:
        self.page = page
        self.frames: list[Image.Image] = []

    @property
    def time_s(self) -> int:
        """The simulated time that the page shows [s]."""
        minutes, seconds = self.page.text("time").split(":")
        return 60 * int(minutes) + int(seconds)

    def go_to_begin(self) -> None:
        """Step to where the film begins, as fast as the run goes; go on at the speed of the film."""
        self.page.until(lambda: self.page.text("status") == "live")
        self.page.at("pause").click()
        self.page.until(lambda: self.page.text("status") == "paused")
        Select(self.page.at("speed")).select_by_value("0")
        for time_s in range(self.time_s + 1, STATION_BEGIN_S + 1):
            self.page.at("step").click()
            self.page.until(lambda time_s=time_s: self.time_s == time_s)
        self.page.at("layer-labels").click()
        self.page.at("map-in").click()
        Select(self.page.at("speed")).select_by_value(str(STATION_SPEED))
        self.page.at("pause").click()

    def take_until(self, time_s: int) -> None:
        """Take a frame every few simulated seconds."""
        while (now_s := self.time_s) < time_s:
            self.picture()
            self.page.until(lambda now_s=now_s: self.time_s >= now_s + STATION_EVERY_S)

    def picture(self) -> None:
        """Take a frame."""
        self.frames.append(Image.open(BytesIO(self.page.driver.get_screenshot_as_png())).convert("RGB"))

    def click(self, element: WebElement) -> None:
        """Take a frame with a ring around an element, and click it."""
        where = element.rect
        self.picture()
        x, y = where["x"] + where["width"] / 2, where["y"] + where["height"] / 2
        ImageDraw.Draw(self.frames[-1]).circle((x, y), 22, outline="#d6556d", width=4)
        self.frames += [self.frames[-1]] * 3
        element.click()


@contextmanager
def station(folder: Path) -> Iterator[str]:
    """Start a run with a station at real time; yield the address of its page, and end the run."""
    command = [
        sys.executable,
        "-m",
        "deltaswarm_orchestrator",
        "run",
        "paper-25",
        "--station",
        f"--out={folder / 'run'}",
    ]
    command += [f"--seed={SEED}", *(f"--set={key}={value}" for key, value in STATION_KEYS.items())]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as run:
        assert run.stderr is not None
        line = next(line for line in run.stderr if line.startswith("station: "))
        try:
            yield line.split()[1]
        finally:
            run.send_signal(signal.SIGINT)
            run.communicate()


def save(frames: Sequence[Image.Image], file: Path, frame_ms: int) -> None:
    """Write an animation that loops."""
    frames[0].save(
        file, save_all=True, append_images=frames[1:], duration=frame_ms, loop=0, lossless=True, quality=80, method=6
    )
    print(f"{file}: {len(frames)} frames, {file.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    name = sys.argv[1]
    make, frame_ms = {"swarm": (swarm_frames, 80), "quads": (quads_frames, 120), "station": (station_frames, 160)}[name]
    save(make(), FIGURES / f"{name}.webp", frame_ms)

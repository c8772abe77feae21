"""A swarm at work as drawn: every agent and event, lines to parents, the density that the world draws from."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.colors import to_hex
from matplotlib.patches import Polygon

from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_orchestrator.scenarios.load import load_scenario
from deltaswarm_scenario.density import ComponentSettings, DensitySettings
from deltaswarm_scenario.scenario import ArenaSettings, Scenario
from deltaswarm_scenario.truth import AgentState, EventState
from deltaswarm_studies import style
from deltaswarm_studies.swarm import DrawnSwarm, edges, kind_of, level_holding, phi, snapshot, swarm
from deltaswarm_wire.messages import NOBODY
from deltaswarm_world.core.density import Places
from deltaswarm_world.core.obstacles import Obstacles
from tests.support.truths import ROLES

BODIES = (
    AgentState(0, 50, 50, "root", 0, NOBODY),
    AgentState(1, 57, 50, "member", 1, 0),
    AgentState(2, 64, 50, "member", 2, 1),
    AgentState(3, 71, 50, "orphan", 3, 2),
    AgentState(4, 20, 20, "free", 0, NOBODY),
    AgentState(5, 30, 80, "attending", 0, NOBODY),
    AgentState(6, 40, 40, "relocating", 0, NOBODY),
    AgentState(7, 78, 50, "member", 9, 2),
    AgentState(8, 5, 95, "dead", 0, NOBODY),
    AgentState(9, 44, 56, "member", 1, 77),  # its parent is hearsay
    AgentState(10, 60, 10, "leaving", 0, NOBODY),
)
EVENTS = tuple(EventState(i, 10.0 * i, 5.0 * i + 30, 0.0, None, None, None, 0.0) for i in range(1, 8))


def shot(bodies: tuple[AgentState, ...] = BODIES, events: tuple[EventState, ...] = EVENTS) -> DrawnSwarm:
    return DrawnSwarm(600.0, 100.0, 100.0, 5.0, bodies, events, phi(Scenario(), 50))


def places(axes: Axes, name: str) -> np.ndarray:
    (line,) = [line for line in axes.lines if line.get_label() == name]
    return np.column_stack(line.get_data())


def segments(axes: Axes) -> list[np.ndarray]:
    (drawn,) = [c for c in axes.collections if isinstance(c, LineCollection) and c.get_label() == "edges"]
    return drawn.get_segments()


def test_every_agent_is_drawn_once() -> None:
    assert set(ROLES) == {body.role for body in BODIES}
    axes = swarm({"hybrid 3": shot()}).axes[0]
    drawn = np.concatenate([np.column_stack(line.get_data()) for line in axes.lines if line.get_label() != "events"])
    assert sorted(map(tuple, drawn.tolist())) == sorted((body.x_m, body.y_m) for body in BODIES)


def test_roots_are_blue_and_levels_have_their_colours() -> None:
    """Square roots in the root's colour; what is deeper than the last colour has the last."""
    axes = swarm({"hybrid 3": shot()}).axes[0]
    (root,) = [line for line in axes.lines if line.get_label() == "root"]
    assert to_hex(root.get_markerfacecolor()) == style.LEVELS[0]
    assert places(axes, "root").tolist() == [[50, 50]]
    faces = {body.agent: kind_of(body).markerfacecolor for body in BODIES}
    assert (faces[1], faces[2], faces[3]) == style.LEVELS[1:4]
    assert faces[7] == style.LEVELS[-1]
    assert places(axes, "level 5 or deeper").tolist() == [[78, 50]]


def test_free_attending_and_relocating_agents_have_markers_of_their_own() -> None:
    kinds = {body.role: kind_of(body) for body in BODIES}
    markers = [kinds[role].marker for role in ("free", "attending", "relocating", "root", "member", "dead")]
    assert len(set(markers)) == 6
    assert kinds["leaving"] == kinds["free"]


def test_lines_go_from_children_to_parents() -> None:
    """Of members; an orphan has lost its parent, and one that nobody has seen has no place."""
    expected = [((57, 50), (50, 50)), ((64, 50), (57, 50)), ((78, 50), (64, 50))]
    assert list(edges(BODIES)) == expected
    drawn = [tuple(map(tuple, segment.tolist())) for segment in segments(swarm({"hybrid 3": shot()}).axes[0])]
    assert drawn == expected


def test_every_event_is_drawn() -> None:
    axes = swarm({"hybrid 3": shot()}).axes[0]
    assert places(axes, "events").tolist() == [[event.x_m, event.y_m] for event in EVENTS]
    (line,) = [line for line in axes.lines if line.get_label() == "events"]
    assert (line.get_marker(), line.get_color()) == ("o", style.BLACK)
    assert len(places(swarm({"hybrid 3": shot(events=())}).axes[0], "events")) == 0


def test_panels_are_aligned_and_the_legend_shared() -> None:
    """Three panels of one size, lettered; one legend with what is drawn in any of them, nothing cut off."""
    free = tuple(body for body in BODIES if body.role in ("free", "attending"))
    figure = swarm({"decentralised": shot(free), "hierarchical": shot(), "hybrid 3": shot(BODIES[:2])})
    with style.drawing():
        figure.draw_without_rendering()
    boxes = [axes.bbox for axes in figure.axes]
    assert [axes.get_title() for axes in figure.axes] == ["(a) decentralised", "(b) hierarchical", "(c) hybrid 3"]
    assert len({(round(box.y0, 3), round(box.width, 3), round(box.height, 3)) for box in boxes}) == 1
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names[:4] == ["free", "attending", "root", "level 1"]
    assert {"level 5 or deeper", "event", "95 % of events"} <= set(names)
    assert "level 4" not in names
    page, legend = figure.bbox, figure.legends[0].get_window_extent()
    assert page.x0 <= legend.x0 < legend.x1 <= page.x1
    assert page.y0 <= legend.y0 < legend.y1 <= min(axes.get_tightbbox().y0 for axes in figure.axes) + 1
    assert all(axes.get_tightbbox().y1 <= page.y1 for axes in figure.axes)


def test_the_legend_has_what_is_drawn_and_nothing_else() -> None:
    """No events, no tree and a uniform density need no words; an obstacle does."""
    free = tuple(body for body in BODIES if body.role == "free")
    bare = dataclasses.replace(shot(free, events=()), phi=np.full((50, 50), 1e-4))
    assert [text.get_text() for text in swarm({"one": bare}).legends[0].get_texts()] == ["free"]
    walled = dataclasses.replace(bare, obstacles=(((10.0, 10.0), (20.0, 10.0), (20.0, 30.0)),))
    figure = swarm({"one": walled})
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["free", "obstacle"]
    [wall] = [patch for patch in figure.axes[0].patches if isinstance(patch, Polygon)]
    assert wall.get_xy()[:3].tolist() == [[10, 10], [20, 10], [20, 30]]
    names = [text.get_text() for text in swarm({"one": shot()}).legends[0].get_texts()]
    assert {"event", "to parent", "sensing range in trees", "95 % of events"} <= set(names)


def test_one_shade_means_one_density() -> None:
    dense = dataclasses.replace(shot(), phi=3 * shot().phi)
    images = [axes.images[0] for axes in swarm({"one": shot(), "three": dense}).axes]
    assert [image.get_clim() for image in images] == [(0.0, float(dense.phi.max()))] * 2


def test_the_density_is_shown_in_place() -> None:
    """As an image over the whole arena, its first row at the bottom, and a line around 95 % unless it is uniform."""
    tilted = np.outer(np.arange(1.0, 51.0), np.ones(50))
    image = swarm({"one": dataclasses.replace(shot(), phi=tilted)}).axes[0].images[0]
    assert image.origin == "lower"
    assert list(image.get_extent()) == [0, 100, 0, 100]
    assert np.array_equal(image.get_array(), tilted)
    with_line = len(swarm({"one": shot()}).axes[0].collections)
    flat = dataclasses.replace(shot(), phi=np.full((50, 50), 1e-4))
    assert len(swarm({"one": flat}).axes[0].collections) == with_line - 1


def test_bodies_are_circles_of_their_true_size_with_their_headings() -> None:
    """In metres, whatever the marker's size; points, which have none, get no circle and no word of it."""
    body = AgentState(0, 10.0, 20.0, "free", 0, NOBODY, heading_rad=math.pi / 2)
    figure = swarm({"one": dataclasses.replace(shot((body,)), radius_m=1.5)})
    drawn = {collection.get_label(): collection for collection in figure.axes[0].collections}
    (circle,) = drawn["bodies"].get_paths()
    box = circle.get_extents()
    assert (box.x0, box.x1, box.y0, box.y1) == pytest.approx((8.5, 11.5, 18.5, 21.5))
    assert drawn["headings"].get_segments()[0] == pytest.approx(np.array([[10.0, 20.0], [10.0, 21.5]]))
    assert "body (true size)" in [text.get_text() for text in figure.legends[0].get_texts()]
    points = swarm({"one": shot((body,))})
    assert not [found for found in points.axes[0].collections if isinstance(found, PatchCollection)]
    assert "body (true size)" not in [text.get_text() for text in points.legends[0].get_texts()]


def test_no_snapshots_is_said() -> None:
    with pytest.raises(ValueError, match="no snapshots"):
        swarm({})


def test_a_snapshot_is_the_truth_of_its_time() -> None:
    """The world's own truth of that step, taken in every step up to it, with complete events left out."""
    scenario = load_scenario("smoke", ["control.delta=2"], seed=8)
    taken = snapshot(scenario, 200.0)
    whole = InProcess(scenario)
    for step in range(201):
        truth = whole.world.truth(whole.step(step, False))
    assert taken.time_s == truth.time_s == 200.0
    assert taken.bodies == truth.bodies
    assert any(body.role == "root" for body in taken.bodies)
    assert taken.events == tuple(event for event in truth.events if event.completed_s is None)
    completed = [event for event in whole.world.environment.states() if event.completed_s is not None]
    assert completed
    assert not {event.event for event in completed} & {event.event for event in taken.events}
    assert (taken.width_m, taken.sensing_range_m) == (40.0, 5.0)


@pytest.mark.parametrize("time_s", [-1.0, 300.0])
def test_a_time_outside_the_run_is_said(time_s: float) -> None:
    with pytest.raises(ValueError, match="300 s"):
        snapshot(load_scenario("smoke"), time_s)


ARENA = ArenaSettings(80.0, 40.0)
MIXTURE = (
    ComponentSettings(3.0, (20.0, 30.0), ((60.0, 25.0), (25.0, 40.0))),
    ComponentSettings(1.0, (78.0, 5.0), ((90.0, 0.0), (0.0, 30.0))),  # much of it falls outside
)
WAY_M, WAY_S = ((20.0, 30.0), (70.0, 10.0), (10.0, 5.0)), (1000.0, 5000.0, 5000.0)


def scenario(density: DensitySettings, arena: ArenaSettings = ARENA) -> Scenario:
    base = Scenario()
    return dataclasses.replace(base, arena=arena, events=dataclasses.replace(base.events, density=density))


def densities(folder: Path) -> dict[str, DensitySettings]:
    weights = np.array([[0.0, 1.0, 2.0, 5.0], [4.0, 0.0, 3.0, 1.0]])
    np.save(folder / "weights.npy", weights)
    np.savetxt(folder / "weights.csv", weights, delimiter=",")
    return {
        "gaussian": DensitySettings("gaussian", (30.0, 8.0), ((120.0, -20.0), (-20.0, 40.0))),
        "mixture": DensitySettings("mixture", components=MIXTURE),
        "moving": DensitySettings("gaussian", covariance_m2=((60.0, 25.0), (25.0, 40.0)), path_m=WAY_M, path_s=WAY_S),
        "uniform": DensitySettings("uniform"),
        "npy": DensitySettings("grid", file=str(folder / "weights.npy")),
        "csv": DensitySettings("grid", file=str(folder / "weights.csv")),
    }


@pytest.mark.parametrize("kind", ["gaussian", "mixture", "moving", "uniform", "npy", "csv"])
def test_what_is_drawn_is_what_the_world_draws_from(kind: str, tmp_path: Path) -> None:
    """20,000 of the world's draws over a run fall into coarse cells as often as phi says, within 5 standard errors."""
    shown = scenario(densities(tmp_path)[kind])
    field = phi(shown, 160)
    assert field.sum() * ARENA.width_m * ARENA.height_m / 160**2 == pytest.approx(1)
    drawn, rng, count = Places(shown.events.density, ARENA, Obstacles([])), np.random.default_rng(7), 20_000
    places = np.array([drawn.draw(rng, number * shown.run.duration_s / count) for number in range(count)])
    bounds = [(0, ARENA.height_m), (0, ARENA.width_m)]
    seen, _, _ = np.histogram2d(places[:, 1], places[:, 0], bins=8, range=bounds)
    expected = field.reshape(8, 20, 8, 20).sum(axis=(1, 3)) / field.sum()
    error = 5 * np.sqrt(expected * (1 - expected) / count) + 2e-4
    assert (np.abs(seen / count - expected) < error).all()


def test_the_papers_density_holds_95_percent_in_a_circle() -> None:
    """Of radius sqrt(50 x 5.99) = 17.3 m around the centre: what lies above the level has that area."""
    shown = scenario(DensitySettings(), ArenaSettings(100.0, 100.0))
    field = phi(shown, 400)
    level = level_holding(field, 0.95)
    assert level is not None
    area_m2 = np.mean(field >= level) * 100.0**2
    assert area_m2 == pytest.approx(np.pi * 50 * -2 * np.log(0.05), rel=0.01)


def test_a_uniform_density_has_no_such_level() -> None:
    assert level_holding(phi(scenario(DensitySettings("uniform")), 50), 0.95) is None

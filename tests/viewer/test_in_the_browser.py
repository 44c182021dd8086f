"""What a browser shows: colours where the model projects to, other pictures after a step, contacts, dragging, recordings."""

import threading
import time

import numpy as np
import pytest
import stepper
from models import mjcf
from stepper.viewer import Player, View
from stepper.viewer.window import Window

SCENE = mjcf("browser")
HUES = {1: (1, 0, 0), 2: (0, 0.8, 0), 3: (0, 0, 1), 4: (1, 0, 1), 5: (0, 0.8, 0.8), 6: (0.9, 0.5, 0)}
"""Colours by body."""
ROPE = """<mujoco><worldbody><site name="hook" pos="0 0 1"/><geom name="drum" type="cylinder" size=".2 .1" pos=".3 0 .7" euler="90 0 0"/>
  <body pos=".6 0 .3"><freejoint/><geom size=".05" mass="1"/><site name="load"/></body></worldbody>
  <tendon><spatial name="rope" limited="true" range="0 1.2"><site site="hook"/><geom geom="drum"/><site site="load"/></spatial></tendon>
</mujoco>"""


def pixels(window, points, size=(720, 480)):
    """Where points of the world, (n, 3), are in a picture: columns and rows (n, 2), by the camera that a view begins with."""
    camera = window.server.initial_camera
    eye, target = np.array(camera.position), np.array(camera.look_at)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    away = points - eye
    focal = size[1] / 2 / np.tan(camera.fov / 2)
    depth = away @ forward
    return np.stack([size[0] / 2 + focal * (away @ right) / depth, size[1] / 2 - focal * (away @ up) / depth], axis=1)


def hue(colour):
    """A colour without its brightness."""
    colour = np.asarray(colour, float) - np.min(colour)
    return colour / max(np.linalg.norm(colour), 1e-9)


@pytest.fixture
def sim():
    return stepper.Stepper(stepper.load(SCENE), 2)


def test_every_shape_is_where_the_model_has_it(sim, page_of, photograph):
    with View(sim, port=8200) as view:
        picture = photograph(page_of(view.url))
        seen = 0
        for env in range(2):
            places = np.asarray(sim.xpos[env]) + view.window.offsets[env]
            for body, colour in HUES.items():
                column, row = np.round(pixels(view.window, places[body][None])[0]).astype(int)
                if not (5 <= column < 715 and 5 <= row < 475):
                    continue
                found = picture[row - 1 : row + 2, column - 1 : column + 2].reshape(-1, 3).mean(axis=0)
                # Light changes how bright a colour is, and what is lit strongly is paler; the hue stays.
                assert hue(found) @ hue(colour) > 0.97, f"body {body} of environment {env}: {found} at {column}, {row}"
                seen += 1
        assert seen >= 8


def red(picture):
    """Columns and rows of what is red, (n, 2)."""
    return np.argwhere((picture[..., 0] > 120) & (picture[..., 1] < 90) & (picture[..., 2] < 90))[:, ::-1]


def until(holds, seconds=60.0):
    """Waits until something holds, or says that it does not."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.05)


def test_the_picture_changes_with_the_state_and_the_buttons_work(sim, page_of, photograph, in_background):
    view = View(sim, envs=1, port=8210)
    view.paused = True
    in_background(view)
    page = page_of(view.url)
    first = photograph(page)

    def shown():  # A stepper cannot be read while another thread steps it; what it shows can.
        return float(view.window.frame.time[0])

    before = shown()  # One step was made before the first pause.
    assert before == pytest.approx(sim.timestep)
    # The styles that hide the panel from photographs leave its elements where they are.
    page.get_by_role("button", name="step", exact=True, include_hidden=True).dispatch_event("click")
    until(lambda: shown() > before)
    time.sleep(1)
    assert shown() == pytest.approx(before + sim.timestep)
    view.paused = False
    until(lambda: shown() > 0.25)
    view.paused = True
    time.sleep(1)
    fallen = photograph(page)
    assert np.mean(np.any(first != fallen, axis=2)) > 0.02
    ball = view.window.frame.xpos[:, 1] + view.window.offsets
    assert red(fallen).mean(axis=0) == pytest.approx(pixels(view.window, ball)[0], abs=8)  # The ball is lit from one side.
    page.get_by_role("button", name="reset", exact=True, include_hidden=True).dispatch_event("click")
    until(lambda: shown() <= before)


def test_contacts_are_drawn_and_can_be_hidden(page_of, photograph):
    model = stepper.load("""<mujoco><worldbody><geom type="plane" size="0 0 .1" rgba=".9 .9 .95 1"/>
      <body pos="0 0 .1"><freejoint/><geom type="box" size=".2 .2 .1" rgba=".2 .4 .3 1"/></body></worldbody></mujoco>""")
    sim = stepper.Stepper(model)
    sim.step(nstep=50)
    with View(sim, port=8220) as view:
        page = page_of(view.url)
        shown = photograph(page)
        for label in ("contacts", "contact forces"):
            page.locator(f"xpath=//*[text()='{label}']/following::input[@type='checkbox'][1]").dispatch_event("click")
        time.sleep(1)
        hidden = photograph(page)

    def warm(picture):
        return int(((picture[..., 0] > 150) & (picture[..., 0] - picture[..., 2] > 80)).sum())

    assert warm(shown) > 20
    assert warm(hidden) == 0


@pytest.mark.parametrize("count", [1, 2])
def test_shapes_have_the_sizes_of_their_environments(count):
    """What the browser is told, also of a single environment, and after the model's sizes came back."""
    sim = stepper.Stepper(stepper.load(SCENE), 3)
    with View(sim, envs=list(range(3 - count, 3)), port=8250) as view:

        def widths():
            scales = zip(view.window.scene.parts, view.window._parts, strict=True)
            return {part.name: np.reshape(handle.batched_scales, (count, -1, 3))[:, 0, 0].tolist() for part, handle in scales}

        before = widths()
        factors = np.array([1.0, 2.0, 3.0])
        sim.randomize(geom_size=factors[:, None, None] * sim.model.geom_size)
        view.show()
        after = widths()
        for name, width in before.items():
            expected = width if name.startswith("mesh") else width * factors[-count:]
            np.testing.assert_allclose(after[name], expected, rtol=1e-6, err_msg=name)  # viser has single precision.
        sim.randomize()
        view.show()
        assert widths() == before


def test_tendons_are_drawn_along_their_wrapped_paths():
    """The lines of each environment join the points of `tendon_paths`; a model without spatial tendons has no visible lines."""
    sim = stepper.Stepper(stepper.load(ROPE), 2)
    with View(sim, port=8255) as view:
        sim.step(nstep=20)
        view.show()
        lines = view.window._tendons
        given = lines.points.reshape(2, -1, 2, 3) - view.window.offsets[:, None, None]
        assert lines.visible
        paths = np.asarray(sim.tendon_paths)[:, 0]
        np.testing.assert_allclose(given, np.stack([paths[:, :-1], paths[:, 1:]], axis=2), atol=1e-6)  # viser has single precision.
        # The rope bends around the drum, 0.2 m from its axis.
        assert np.linalg.norm(paths[0, 1:-1, [0, 2]].T - [0.3, 0.7], axis=1).max() == pytest.approx(0.2, abs=1e-9)
    with View(stepper.Stepper(stepper.load(SCENE)), port=8256) as view:
        assert not view.window._tendons.visible


def test_the_panel_may_draw_while_a_simulation_shows(sim, monkeypatch):
    """Threads of viser answer the panel: a picture is drawn by one at a time."""
    failed, drawing = [], []
    contacts = Window._draw_contacts

    def alone(*given):
        drawing.append(1)
        assert len(drawing) == 1
        contacts(*given)
        time.sleep(0.001)
        drawing.pop()

    monkeypatch.setattr(Window, "_draw_contacts", alone)

    def redraw():
        try:
            while view.open:
                view.window._draw()
        except Exception as error:
            failed.append(error)

    with View(sim, port=8260) as view:
        threads = [threading.Thread(target=redraw) for _ in range(2)]
        for thread in threads:
            thread.start()
        frame, sizes = view.window.frame, view.window._sizes
        for k in range(200):
            view.window.show(frame, sizes, pull=np.zeros((2, 3)) if k % 2 else None)
    for thread in threads:
        thread.join()
    assert not failed


def test_a_body_is_dragged_with_the_mouse(page_of, photograph, in_background):
    model = stepper.load("""<mujoco><option gravity="0 0 0"/><worldbody><geom type="plane" size="0 0 .1" pos="0 0 -1" rgba=".9 .9 .95 1"/>
      <body name="ball"><freejoint/><geom size=".3" rgba="1 0 0 1"/></body></worldbody></mujoco>""")
    sim = stepper.Stepper(model, 1)
    view = View(sim, port=8230)
    in_background(view)
    page = page_of(view.url)
    photograph(page)
    column, row = pixels(view.window, np.zeros((1, 3)))[0]
    page.keyboard.down("Control")
    page.mouse.move(column, row)
    page.mouse.down()
    for k in range(1, 11):
        page.mouse.move(column, row - 6 * k)
        time.sleep(0.2)
    until(lambda: view.window.frame.xpos[0, 1, 2] > 0.05)
    assert view.window.pull is not None
    page.mouse.up()
    page.keyboard.up("Control")
    until(lambda: view.window.pull is None)
    view.close()
    time.sleep(0.5)
    assert not np.any(sim.xfrc_applied)


def test_a_recording_is_played(tmp_path, sim, page_of, photograph):
    with sim.record(tmp_path / "run"):
        for _ in range(100):
            sim.step()
    with Player(tmp_path / "run", port=8240, source=SCENE) as player:
        page = page_of(player.url)
        first = photograph(page)
        player.seek(99)
        time.sleep(1)
        last = photograph(page)
        there = red(last)
        at = [pixels(player.window, (np.asarray(sim.xpos[env, 1]) + player.window.offsets[env])[None])[0] for env in range(2)]
    assert np.mean(np.any(first != last, axis=2)) > 0.02
    # A ball of each environment, where it was in the end.
    for place in at:
        if 20 < place[0] < 700:
            near = there[np.linalg.norm(there - place, axis=1) < 60]
            assert near.mean(axis=0) == pytest.approx(place, abs=8)

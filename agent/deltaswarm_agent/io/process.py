"""The agent's process: the only file of an agent that uses Zenoh."""

import logging
import os
import pickle
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from deltaswarm_agent.controller import ControllerError, make_controller
from deltaswarm_agent.core.agent_core import AgentCore, StepOutput
from deltaswarm_wire import checkpoint
from deltaswarm_wire.child import WORLD_LOST
from deltaswarm_wire.codec import WireError
from deltaswarm_wire.keys import ACT, AGENT, FRAME, RADIO, REPORT, TAKEN, WORLD, Keys
from deltaswarm_wire.messages import Act, Frame, decode_frame
from deltaswarm_wire.orders import decode_save, encode_taken
from deltaswarm_wire.plugin_errors import is_interrupt
from deltaswarm_wire.session import (
    RouterLink,
    client_pairs,
    closing,
    configured,
    use_one_worker_thread,
    without_sources,
)
from deltaswarm_wire.settings import AgentSettings

use_one_worker_thread()
import zenoh  # noqa: E402 (reads its thread settings at import)

log = logging.getLogger("deltaswarm.agent")

FRAME_QUEUE = 64
GOODBYE_S = 3.0
"""Time that an agent waits after its last act for the world to exit."""


@dataclass(frozen=True)
class AgentConfig:
    run: str
    agent: int
    link: RouterLink
    settings: AgentSettings
    restart: int = 0
    """Earlier starts of this agent in this run."""
    world_lost_s: float = 5.0
    """Time without a world after which the agent exits."""
    checkpoints: Path | None = None
    """The folder for its part of checkpoints; None: no checkpoints."""
    resume_step: int | None = None
    """Resume the agent that was saved after this step."""


class WorldWatch:
    """Watches the world's liveliness token and exits the process without a world."""

    def __init__(
        self, session: zenoh.Session, keys: Keys, patience_s: float, on_lost: Callable[[], None] = lambda: None
    ) -> None:
        self._on_lost = on_lost
        self.gone = threading.Event()
        self._patience_s = patience_s
        self._timer: threading.Timer | None = None
        self._ending = False
        self._subscriber = session.liveliness().declare_subscriber(keys.token(WORLD), self._on_token, history=True)

    def _on_token(self, sample: zenoh.Sample) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if sample.kind == zenoh.SampleKind.DELETE:
            self.gone.set()
            if not self._ending:
                self._timer = threading.Timer(self._patience_s, self._give_up)
                self._timer.daemon = True
                self._timer.start()
        else:
            self.gone.clear()

    def _give_up(self) -> None:
        log.critical("no world for %g s", self._patience_s)
        self._on_lost()
        logging.shutdown()
        os._exit(WORLD_LOST)  # the main thread is blocked in Zenoh

    def goodbye(self) -> None:
        """Wait for the world's exit, which is expected from now on."""
        self._ending = True
        self.gone.wait(GOODBYE_S)


class Outbox:
    def __init__(self, session: zenoh.Session, keys: Keys, agent: int) -> None:
        def publisher(leaf: str, message: str) -> zenoh.Publisher:
            return session.declare_publisher(
                keys.agent(agent, leaf),
                encoding=zenoh.Encoding(f"application/msgpack;deltaswarm.{message}.v1"),
                congestion_control=zenoh.CongestionControl.BLOCK,
            )

        self._radio = publisher(RADIO, "Radio")
        self._report = publisher(REPORT, "Report")
        self._act = publisher(ACT, "Act")
        self._taken = publisher(TAKEN, "Taken")

    def wait_until_heard(self) -> None:
        """Wait until each publisher knows a subscriber; before that it silently sends nothing."""
        for publisher in (self._radio, self._report, self._act):
            heard = threading.Event()

            def note(status: zenoh.MatchingStatus, heard: threading.Event = heard) -> None:
                if status.matching:
                    heard.set()

            listener = publisher.declare_matching_listener(note)
            note(cast(zenoh.MatchingStatus, publisher.matching_status))
            heard.wait()
            listener.undeclare()

    def send(self, output: StepOutput) -> None:
        """Send a step's output. The act closes the step: it comes last, attached to the radio frame if any."""
        if output.report_bytes is not None:
            self._report.put(output.report_bytes)
        if output.radio is not None:
            self._radio.put(output.radio, attachment=output.act_bytes)
        else:
            self._act.put(output.act_bytes)

    def taken(self, step: int) -> None:
        self._taken.put(encode_taken(step))


def _core(config: AgentConfig) -> tuple[AgentCore, int]:
    """Make or resume the agent; return it with the step of its newest frame. Check that it can be saved, if needed."""
    if config.checkpoints is not None and config.resume_step is not None:
        return load_part(config.checkpoints, config.resume_step, config.agent)
    controller = make_controller(config.agent, config.settings, config.restart)
    core = AgentCore(config.agent, config.settings.step_s, controller)
    if config.checkpoints is not None:
        pickled(core, -1)
    return core, -1


def _save(config: AgentConfig, core: AgentCore, newest: int, step: int, outbox: Outbox) -> None:
    """Save the agent and confirm it to the world. If that fails, log it and continue without this checkpoint."""
    try:
        if config.checkpoints is None:
            raise ControllerError("--checkpoints must be given to save an agent")
        save_part(config.checkpoints, step, core, newest)
    except (ControllerError, OSError) as error:
        log.error("agent %d cannot be saved after step %d: %s", config.agent, step, error)
    else:
        outbox.taken(step)


def check_link(config: AgentConfig) -> None:
    """Raise ValueError if Zenoh refuses the options of the link to the world."""
    configured(zenoh.Config, client_pairs(config.link), config.link)


def run_agent(
    config: AgentConfig,
    on_ready: Callable[[], None] = lambda: None,
    on_step: Callable[[Frame, Act], None] = lambda frame, act: None,
    on_lost: Callable[[], None] = lambda: None,
) -> int:
    """Run one agent until its last frame; return the exit code.

    `on_ready` is called once its token is declared, `on_step` after each step with what it sensed and does, `on_lost`
    before the process exits for want of a world.
    """
    zenoh.init_log_from_env_or("error")
    keys = Keys(config.run)
    core, newest = _core(config)
    settings = configured(zenoh.Config, client_pairs(config.link), config.link)
    try:
        opened = zenoh.open(settings)
    except zenoh.ZError as error:
        log.critical("cannot join the world at %s: %s", config.link.endpoint, without_sources(str(error)))
        return WORLD_LOST
    with closing(opened, log.warning) as session:
        frames = session.declare_subscriber(keys.agent(config.agent, FRAME), zenoh.handlers.FifoChannel(FRAME_QUEUE))
        outbox = Outbox(session, keys, config.agent)
        watch = WorldWatch(session, keys, config.world_lost_s, on_lost)
        outbox.wait_until_heard()
        token = session.liveliness().declare_token(keys.token(AGENT, config.agent))
        log.info("agent %d is ready", config.agent)
        on_ready()
        rejected = 0
        while True:
            sample = frames.recv()
            data = sample.payload.to_bytes()
            try:
                if sample.attachment is not None:
                    _save(config, core, newest, decode_save(data), outbox)
                    continue
                frame = decode_frame(data)
            except WireError as error:
                rejected += 1
                if rejected == 1:
                    log.warning("dropped a frame: %s", error)
                continue
            if frame.step <= newest:
                continue
            newest = frame.step
            output = core.step(frame)
            outbox.send(output)
            on_step(frame, output.act)
            if frame.last:
                break
        watch.goodbye()
        token.undeclare()
    log.info(
        "agent %d exits after step %d; rejected world's frames %d, %s", config.agent, newest, rejected, core.counts
    )
    return 0


def pickled(core: AgentCore, newest: int) -> bytes:
    """Pickle an agent with the step of its newest frame (-1 before the first)."""
    try:
        return pickle.dumps((core, newest))
    except BaseException as error:  # a controller may be a plug-in
        if is_interrupt(error):
            raise
        name = f"{type(core.controller).__module__}:{type(core.controller).__qualname__}"
        raise ControllerError(f"controller {name} cannot be saved in a checkpoint", error) from error


def save_part(folder: Path, step: int, core: AgentCore, newest: int) -> None:
    """Write an agent's part of the checkpoint after a step. Raises ControllerError, OSError."""
    checkpoint.write(folder / str(step) / checkpoint.agent_file(core.agent), pickled(core, newest))


def load_part(folder: Path, step: int, agent: int) -> tuple[AgentCore, int]:
    """Load an agent's state after a step, and the step of its newest frame."""
    file = folder / str(step) / checkpoint.agent_file(agent)
    try:
        core, newest = pickle.loads(file.read_bytes())
        return core, newest
    except BaseException as error:  # the file, or a plug-in, may raise anything
        if is_interrupt(error):
            raise
        raise ControllerError(f"{file} cannot be read", error) from error

"""How a run ends: why it ended too early, for which reason, and what the logs of failed parts say."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from deltaswarm_orchestrator.processes.process import RunPart
from deltaswarm_wire.plugin_errors import distinct

Reason = str | RunPart
"""A line of `why`. An agent stands for its own line: the world knows the step in which it was lost."""


@dataclass
class Ending:
    """How a run ends."""

    why: list[Reason] = field(default_factory=list)
    """Why the run ended too early, and what was lost, in the order in which it happened."""
    cause: Reason | None = None
    """The entry of `why` that ended the run; None if the run did not end too early, or the user ended it."""
    when: str = "before the first step"
    """Where the run was when its steps ended."""
    agents: Sequence[RunPart] = ()
    """The processes of agents, which have ended when the run is concluded."""
    texts: list[str] = field(default_factory=list)
    """Tracebacks of the orchestrator's own errors."""
    logs: dict[str, str] = field(default_factory=dict)
    """The last log lines of failed parts that were not restarted, by part name."""
    traces: dict[str, str] = field(default_factory=dict)
    """The tracebacks with which such logs end, by part name."""
    operator_restarts: int = 0
    disk_is_full: bool = False
    """Whether `why` has the line of a part that found the disk full. More lines would say the same."""

    def fail(self, reason: Reason) -> None:
        """Note what went wrong; it ends the run unless something did so earlier."""
        self.why.append(reason)
        self.cause = self.cause or reason

    def keep_log(self, part: RunPart) -> None:
        """Keep what the log of a failed part says."""
        self.logs[part.name], self.traces[part.name] = part.log_tail(), part.trace

    def forget_log(self, part: RunPart) -> None:
        """Forget the log of a part that was started again."""
        self.logs.pop(part.name, None)
        self.traces.pop(part.name, None)

    @property
    def messages(self) -> list[str]:
        """What logs and tracebacks say, for the user: each traceback once, of other logs the last lines."""
        traces = {part: trace for part, trace in self.traces.items() if trace}
        shown = [
            f"the traceback of {parts[0]}" + (f" and {len(parts) - 1} other parts" if parts[1:] else "") + f":\n{trace}"
            for trace, parts in distinct(traces).items()
        ]
        tails = {part: tail for part, tail in self.logs.items() if tail and part not in traces}
        return self.texts + shown + [f"the last lines of the log of {part}:\n{tail}" for part, tail in tails.items()]

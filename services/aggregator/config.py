"""Configuration of an aggregator service."""

from dataclasses import dataclass, field
from pathlib import Path

from protocol.keys import KeyNameError, checked
from sfid_core.crowd.round import RoundSettings
from sfid_core.crowd.settings import CrowdSettings
from sfid_core.learning.parameters import ParameterError


@dataclass(frozen=True, slots=True)
class AggregatorConfig:
    """One aggregator process. Raises: KeyNameError, ParameterError.

    The crowd is a deployment of its own: its members use the keys of `crowd_deployment`, the learner those of
    `deployment`, and sessions have one name on both sides.
    """

    data_dir: Path
    """The deployment's directory; the aggregator's journal is in `crowd-NAME` below it."""
    name: str = "crowd"
    """The name under which the crowd teaches."""
    deployment: str = "local"
    crowd_deployment: str = "local-crowd"
    sessions: tuple[str, ...] = ()
    """Sessions that the crowd may teach; empty: every session that a member asks for."""
    rounds: RoundSettings = field(default_factory=RoundSettings)
    weighing: CrowdSettings = field(default_factory=CrowdSettings)
    solver: bool = True
    """Whether naming another optimal action costs no reliability, where the exact solver knows them."""
    gold_share: float = 0.0
    """Share in [0, 1] of the states with one optimal action that measure the workers, unseen by them."""
    seed: int = 0
    """Names which states are gold."""
    require_tokens: bool = False
    """Whether members are let in only with a token that the secret of `data_dir` has signed; the crowd then
    bears one of its own towards the learner."""
    check_secrets: tuple[bytes, ...] = field(default=(), repr=False)
    """What keys the checks of acknowledgements; empty: they have no key."""
    inbox_max: int = 16_384
    waiting_max: int = 32
    """Of these, messages of one sender and kind: who floods holds up themselves."""
    commit_every_ms: int = 500
    members_gone_ms: int = 5_000
    """How long a member's token may take to come (back) before the member counts as gone."""
    members_max: int = 10_000
    sessions_max: int = 1_000
    report_every_ms: int = 250
    """The shortest time between two reports to the monitor."""

    def __post_init__(self) -> None:
        checked(self.name, "aggregator")
        checked(self.crowd_deployment, "crowd deployment")
        for session in self.sessions:
            checked(session, "session")
        if self.crowd_deployment == self.deployment:
            message = f"deployment {self.deployment!r} is the learner's: give the crowd another"
            raise KeyNameError(message)
        if not 0 <= self.gold_share <= 1:
            message = f"gold_share {self.gold_share} is outside [0, 1]: 0.1 is usual"
            raise ParameterError(message)

    @property
    def journal_dir(self) -> Path:
        """Where the aggregator's journal is."""
        return self.data_dir / f"crowd-{self.name}"

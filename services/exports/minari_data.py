"""A session as a Minari data set: what the agent did, with what teachers said about each step beside it.

Entry 0 of every info belongs to the reset and entry t + 1 to step t, so that infos are one longer than
actions: of Minari's formats, Arrow and Parquet refuse anything else.
"""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from protocol.messages import World
from services.exports.session_story import StepRow as Step
from services.exports.session_story import Story, kept_steps
from services.exports.session_tables import session_tables
from services.exports.table import ExportError
from services.exports.write import Format, write_tables

NAMESPACE = "sfid"
NOTHING = -1
"""In `label`: nobody named an action."""


def write_minari(story: Story, root: Path) -> Path:
    """Write the data set `sfid/<session>-v0` below a folder of data sets, and return its own folder.

    `MINARI_DATASETS_PATH=root` makes `minari.load_dataset` find it. Beside the data stand the session's
    tables (`tables/`), which hold every answer, applied or not. Steps that were taken back are left out.

    Raises: ExportError, one line with the mend.
    """
    root = root.resolve()  # Minari loses its way from a relative one
    folder = root / NAMESPACE / f"{story.config.session}-v0"
    if (folder / "data" / "metadata.json").exists():
        raise ExportError(f"{folder} holds a data set already: remove it, or name another --out")
    try:
        from gymnasium import spaces  # noqa: PLC0415 - an extra
        from minari import __version__  # noqa: PLC0415 - as above
        from minari.data_collector import EpisodeBuffer  # noqa: PLC0415 - as above
        from minari.dataset.minari_storage import MinariStorage  # noqa: PLC0415 - as above
    except ImportError as error:
        raise ExportError(f"Minari is not installed ({error}): install sfid[gym]") from None
    observed = _Observed(story, spaces)
    if not story.episodes:
        raise ExportError(f"session {story.config.session} has no finished episode yet: teach it first")
    buffers = [
        EpisodeBuffer(id=number, seed=story.config.seed, **_buffer(story, observed, kept_steps(steps)))
        for number, steps in story.by_episode().items()
    ]
    try:
        (folder / "data").mkdir(parents=True, exist_ok=True)
        _declare(root)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            storage = MinariStorage.new(
                folder / "data", observation_space=observed.space,
                action_space=spaces.Discrete(len(story.actions)), data_format="arrow", jpeg_encoding=False,
            )  # fmt: skip
            storage.update_metadata(_about(story, observed, __version__))
            storage.update_episodes(buffers)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ExportError(f"cannot write into {folder}: {reason}; give a folder you may write to") from error
    about = f"Session {story.config.session}, from its journal."
    write_tables(folder / "tables", about, session_tables(story), (Format.PARQUET,))
    return folder


class _Observed:
    """What the agent saw as numbers: a Sokoban board cell by cell, another world's states by index."""

    def __init__(self, story: Story, spaces: Any) -> None:  # noqa: ANN401 - a module of an extra
        self.is_board = isinstance(story.config.world, World)
        self.keys: list[str] = []
        if self.is_board:
            from services.gym.sokoban import GLYPHS  # noqa: PLC0415 - imports Gymnasium

            self._numbers = {glyph: number for number, glyph in enumerate(GLYPHS)}
            shape = np.shape(self.of(b"", story.config.world.level))  # type: ignore[union-attr]
            self.space = spaces.Box(0, len(GLYPHS) - 1, shape, np.uint8)
            return
        states = [each for row in story.steps for each in (row.measures.state, row.next_state)]
        self._indexes = {state: index for index, state in enumerate(dict.fromkeys(states))}
        self.keys = [state.hex() for state in self._indexes]
        self.space = spaces.Discrete(max(1, len(self.keys)))

    def of(self, state: bytes, view: str) -> Any:  # noqa: ANN401 - an array or a number
        """Return the observation of a state."""
        if self.is_board:
            return np.array([[self._numbers[glyph] for glyph in row] for row in view.split("\n")], np.uint8)
        return np.int64(self._indexes[state])


def _buffer(story: Story, observed: _Observed, steps: Sequence[Step]) -> dict[str, Any]:
    """Return the parts of an episode of T steps: T + 1 observations and infos, T of everything else."""
    first, outcomes = steps[0].measures, [row.measures.outcome for row in steps]
    seen = [observed.of(first.state, first.view)]
    seen += [observed.of(row.next_state, row.measures.next_view) for row in steps]
    return {
        "observations": np.stack(seen),
        "actions": np.array([row.measures.action for row in steps], np.int64),
        "rewards": [row.measures.reward for row in steps],
        "terminations": [outcome.terminal for outcome in outcomes],
        "truncations": [outcome.value == "cap" for outcome in outcomes],
        "infos": _infos(story, steps),
    }


def _infos(story: Story, steps: Sequence[Step]) -> dict[str, Any]:
    learnt = [row.measures for row in steps]
    waited = {row.message.decision: row.latency_ms for row in story.answers if row.applied}
    latencies = [waited.get(one.decision) for one in learnt]
    nan = float("nan")
    states = [steps[0].measures.state, *(row.next_state for row in steps)]
    # One number a step goes as a list: Minari writes arrays of one dimension that it cannot read again.
    return {
        "decision": [NOTHING, *(one.decision for one in learnt)],
        "label": [NOTHING, *(NOTHING if one.label is None else one.label for one in learnt)],
        "answers": [0, *(len(one.answers) for one in learnt)],
        "latency_ms": [nan, *(nan if each is None else each for each in latencies)],
        "h": [0.0, *(one.learned.h for one in learnt)],
        "td_error": [0.0, *(one.learned.environment for one in learnt)],
        "td_error_shaped": [0.0, *(one.learned.shaped for one in learnt)],
        "q": np.array([[nan] * len(story.actions), *(one.values for one in learnt)], np.float64),
        "state": np.array([list(state) for state in states], np.uint8),
    }


def _about(story: Story, observed: _Observed, version: str) -> dict[str, Any]:
    config = story.config
    return {
        "dataset_id": f"{NAMESPACE}/{config.session}-v0",
        "minari_version": version,
        "algorithm_name": config.method,
        "description": f"Session {config.session}: {config.method} taught in {config.world.level_name}.",
        "action_names": list(story.actions),
        "state_keys": observed.keys,
        "q_sha256": story.session.learner.sha256(),
        "teachers": len({row.message.teacher for row in story.answers}),
    }


def _declare(root: Path) -> None:
    """Make the namespace known, as Minari's own functions do."""
    described = root / NAMESPACE / "namespace_metadata.json"
    if not described.exists():
        described.write_text('{"description": "Sessions taught with SfID"}\n', encoding="utf-8")

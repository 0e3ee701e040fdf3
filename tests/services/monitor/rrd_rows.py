"""Reads a recording back, row by row; for tests of the monitor."""

from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader


def rows_of(path: Path, entity: str, component: str) -> list[tuple[dict[str, Any], list[Any]]]:
    """Return (times by timeline, values) of every logged row of a component, by decision."""
    rows = []
    for chunk in RrdReader(path).stream().to_chunks():
        if chunk.entity_path != f"/{entity}" or chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        if component not in batch.schema.names:
            continue
        times = {name: batch.column(name).cast("int64").to_pylist() for name in chunk.timeline_names}
        for number, values in enumerate(batch.column(component).to_pylist()):
            rows.append(({name: column[number] for name, column in times.items()}, values))
    return sorted(rows, key=lambda row: row[0]["step"])


def entities_of(path: Path) -> set[str]:
    """Return every entity of a recording that the monitor writes."""
    paths = {chunk.entity_path for chunk in RrdReader(path).stream().to_chunks()}
    return {entity.removeprefix("/") for entity in paths if not entity.startswith("/__")}

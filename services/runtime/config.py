"""The one configuration file, TOML; flags override it."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta
from msgspec.structs import FieldInfo

from services.runtime.schema_fault import in_words

Port = Annotated[int, Meta(ge=0, le=65_535)]


class ConfigError(ValueError):
    """The configuration file is wrong; the text is one line: what, where, and the mend."""


class MonitorSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[monitor]: where viewers find it; port 0 takes a free one."""

    enabled: bool = True
    """Whether sessions are drawn at all."""
    viewer: bool = True
    """Whether viewers are served; otherwise sessions are only recorded."""
    scene_port: Port = 19_876
    """Port of the picture's stream; 0 takes a free one."""
    curves_port: Port = 19_877
    """Port of the curves' stream; 0 takes a free one."""
    web_port: Port = 19_090
    """Port of the viewer's web page; 0 takes a free one."""


class GatewaySection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[gateway]: the teaching page for browsers; off unless asked for."""

    enabled: bool = False
    """Whether the page is served."""
    listen: str = "127.0.0.1:7480"
    """HOST:PORT of the page; port 0 takes a free one."""
    url: str | None = None
    """Address that browsers use, where it is another (a proxy's, say)."""
    tls_cert: str | None = None
    """PEM file of the certificate chain; the page is then encrypted."""
    tls_key: str | None = None
    """PEM file of its key."""
    insecure_bind: bool = False
    """Whether to listen where other machines reach it, although nothing is encrypted."""
    crowd: bool = False
    """Whether its people are members of the crowd instead of teachers of the learner."""


class LearnerSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[learner]: how many share the sessions out."""

    shards: Annotated[int, Meta(ge=1, le=64)] = 1
    """Shards of the data directory, for good, and processes: where one dies the others go on with its own."""


class AggregatorSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[aggregator]: a crowd that teaches as one teacher; off unless asked for."""

    enabled: bool = False
    """Whether a crowd can teach."""
    name: Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,47}$")] = "crowd"
    """The name under which the crowd teaches; its journal is in crowd-NAME of the data directory."""
    method: str = "one-coin"
    """How answers are weighed: majority, weighted, one-coin or dawid-skene."""
    quorum: Annotated[int, Meta(ge=0)] = 0
    """Answers that close a decision; 0: everybody present."""
    margin_ms: Annotated[int, Meta(ge=0, le=60_000)] = 100
    """How long before the learner's deadline the crowd closes."""
    patience_ms: Annotated[int, Meta(ge=1, le=3_600_000)] = 5_000
    """How long after the first answer it closes where there is no deadline."""
    abstain_below: Annotated[float, Meta(ge=0, le=1)] = 0.6
    """The crowd abstains when its best action is less probable than this."""
    gold_share: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Share of the states with one optimal action that measure the workers, unseen by them."""


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A supervised set of services (`sfid up`)."""

    data: str = "sfid-data/up"
    """Directory of journal, logs and recordings."""
    listen: str = "tcp/127.0.0.1:7447"
    """Endpoint of the router: tcp/HOST:PORT on this machine, tls/HOST:PORT for others."""
    deployment: Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,47}$")] = "local"
    """Name of the deployment; two on one router never meet."""
    require_tokens: bool | None = None
    """Whether teachers, and members of the crowd, are let in only with a token of `sfid keys new` or
    `sfid invite`; not said: where other machines reach the router."""
    learner: LearnerSection = LearnerSection()
    monitor: MonitorSection = MonitorSection()
    gateway: GatewaySection = GatewaySection()
    aggregator: AggregatorSection = AggregatorSection()


def config_keys() -> Iterator[tuple[str, type[msgspec.Struct], FieldInfo]]:
    """Yield every key as it is written in the file, the structure that it is a field of, and the field."""
    sections: list[tuple[str, type[msgspec.Struct]]] = [("", Config)]
    for prefix, kind in sections:
        for field in msgspec.structs.fields(kind):
            if isinstance(field.type, type) and issubclass(field.type, msgspec.Struct):
                sections.append((f"{field.encode_name}.", field.type))
            else:
                yield f"{prefix}{field.encode_name}", kind, field


def read_config(path: Path) -> Config:
    """Return the configuration in a TOML file; raise ConfigError naming the key and what is known."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        message = f"{path}: {error.strerror or error}: name a readable TOML file"
        raise ConfigError(message) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        message = f"{path}: not TOML: {error}"
        raise ConfigError(message) from None
    try:
        return msgspec.convert(document, Config)
    except msgspec.ValidationError as error:
        known = ", ".join(name for name, _, _ in config_keys())
        message = f"{path}: {in_words(str(error))}; known keys are {known}"
        raise ConfigError(message) from None

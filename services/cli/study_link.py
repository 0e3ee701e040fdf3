"""The link that participants of a study are given: the same each time the study is started."""

import os
import time
from pathlib import Path

from protocol.identity import Identity, Role, TokenError, sign, verify
from services.gateway.config import GatewayConfig
from services.gateway.service import read_status
from services.runtime.register import new_token_id
from services.runtime.secret import load_secrets
from services.study.book import study_folder
from services.study.definition_file import StudyFile
from sfid_core.study.definition import Recruiter

NAME = "invitation"
DAY_S = 86_400
PLACEHOLDERS = {
    Recruiter.NONE: "",
    Recruiter.PROLIFIC: (
        "?PROLIFIC_PID={{%PROLIFIC_PID%}}&STUDY_ID={{%STUDY_ID%}}&SESSION_ID={{%SESSION_ID%}}"
    ),
    Recruiter.MTURK: "?workerId={workerId}&assignmentId={assignmentId}&hitId={hitId}",
}
"""What Prolific fills in, in its own notation; for MTurk the HIT's page has to, from its own address.

Left as they are the study refuses them: they are no identifiers.
"""


def participants_link(found: StudyFile, data: Path) -> str:
    """Return the link to a running study; its page must have written down its address."""
    secrets = load_secrets(GatewayConfig(data).folder)
    path = study_folder(data, found.study.name) / NAME
    token = _kept(path, secrets)
    if token is None:
        identity = Identity(
            role=Role.INVITATION,
            session=found.study.name,
            expires_s=int(time.time() + found.days * DAY_S),
            token_id=new_token_id(),
            people=found.people,
        )
        token = sign(identity, secrets)
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(handle, "w") as file:
            file.write(token)
    address = str(read_status(data)["url"])
    return f"{address}/{PLACEHOLDERS[found.study.recruiter]}#t={token}"


def _kept(path: Path, secrets: list[bytes]) -> str | None:
    """Return the invitation of an earlier start, None when there is none that is good for another hour."""
    try:
        token = path.read_text().strip()
        verify(token, secrets, time.time() + 3600, set())
    except (OSError, TokenError):
        return None
    return token

"""The page's files, and the rules that every request has to pass before anything is served."""

from http import HTTPStatus
from importlib.resources import files

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

SOCKET_PATH = "/socket"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'{sockets}; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Embedder-Policy": "require-corp",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
}
HSTS = "max-age=31536000"


class Page:
    """The files of `page/`, read once."""

    def __init__(self, *, tls: bool) -> None:
        self._extra = {"Content-Security-Policy": POLICY.format(sockets="")}
        if tls:
            self._extra["Strict-Transport-Security"] = HSTS
        folder = files("services.gateway").joinpath("page")
        self._files: dict[str, tuple[str, bytes]] = {}
        for entry in folder.iterdir():
            suffix = entry.name[entry.name.rfind(".") :]
            if suffix in _TYPES:
                self._files[f"/{entry.name}"] = (_TYPES[suffix], entry.read_bytes())
        self._files["/"] = self._files["/index.html"]

    def meet(self, address: str) -> None:
        """Allow websockets to the page's own address by name: older browsers do not count them as 'self'."""
        sockets = f" {address.replace('http', 'ws', 1)}{SOCKET_PATH}"
        self._extra["Content-Security-Policy"] = POLICY.format(sockets=sockets)

    def file(self, request: Request) -> Response | None:
        """Return the file that a request asks for; None when there is none of that name."""
        found = self._files.get(request.path.partition("?")[0])
        return None if found is None else self.response(HTTPStatus.OK, *found)

    def refusal(self, status: HTTPStatus) -> Response:
        """Return a refusal that tells nothing but its status."""
        return self.response(status, _TYPES_TEXT, f"{status.value} {status.phrase}\n".encode())

    def response(self, status: HTTPStatus, content_type: str, body: bytes) -> Response:
        """Return a response with all headers of safety."""
        headers = Headers({"Content-Type": content_type, "Content-Length": str(len(body))})
        for name, value in (SECURITY_HEADERS | self._extra).items():
            headers[name] = value
        headers["Connection"] = "close"
        return Response(status.value, status.phrase, headers, body)


_TYPES_TEXT = "text/plain; charset=utf-8"

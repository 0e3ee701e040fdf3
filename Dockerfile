# Two images from one file; both are without a compiler, a package installer and a privileged user.
#
#   docker build --target service -t sfid .           router, environment, learner, teachers, gateway
#   docker build --target monitor -t sfid-monitor .   the same with the viewer (about 0.5 GB more)
#
# Any image with Python 3.11 or newer, venv and pip serves as BASE. Packages come from pip's usual index; another
# one is named in a pip.conf that only the installation sees: add `--secret id=pip,src=pip.conf`.
ARG BASE=python:3.11-slim

FROM ${BASE} AS wheel
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY sfid_core sfid_core
COPY protocol protocol
COPY services services
RUN --mount=type=secret,id=pip,target=/etc/pip.conf python3 -m pip wheel --quiet --no-cache-dir --no-deps --wheel-dir /wheel .

# The locked dependencies come first: they change seldom, so this layer is reused while the code changes.
FROM ${BASE} AS dependencies-service
COPY requirements-services.lock /
RUN --mount=type=secret,id=pip,target=/etc/pip.conf python3 -m venv /opt/sfid \
    && /opt/sfid/bin/pip install --quiet --no-cache-dir --require-hashes --no-deps -r /requirements-services.lock

FROM ${BASE} AS dependencies-monitor
COPY requirements-monitor.lock /
RUN --mount=type=secret,id=pip,target=/etc/pip.conf python3 -m venv /opt/sfid \
    && /opt/sfid/bin/pip install --quiet --no-cache-dir --require-hashes --no-deps -r /requirements-monitor.lock

FROM dependencies-service AS built-service
COPY --from=wheel /wheel /wheel
RUN /opt/sfid/bin/pip install --quiet --no-cache-dir --no-deps /wheel/*.whl \
    && /opt/sfid/bin/pip uninstall --quiet --yes setuptools pip

FROM dependencies-monitor AS built-monitor
COPY --from=wheel /wheel /wheel
RUN /opt/sfid/bin/pip install --quiet --no-cache-dir --no-deps /wheel/*.whl \
    && /opt/sfid/bin/pip uninstall --quiet --yes setuptools pip

# What both images are at run time. A volume takes over the owner of where it is mounted; without one nothing
# is kept. /logins is the router's, /access everybody else's.
FROM ${BASE} AS runtime
ENV PATH=/opt/sfid/bin:$PATH HOME=/tmp PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
RUN install --directory --owner=10001 --group=10001 --mode=0750 /data /access /logins \
    /logins/environment /logins/learner /logins/aggregator /logins/gateway /logins/monitor \
    /logins/operator /logins/teacher /logins/worker
WORKDIR /data
USER 10001:10001
ENTRYPOINT ["sfid"]
CMD ["--help"]

FROM runtime AS monitor
COPY --from=built-monitor /opt/sfid /opt/sfid

FROM runtime AS service
COPY --from=built-service /opt/sfid /opt/sfid

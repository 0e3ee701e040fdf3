# `make check` runs what continuous integration runs (.ci/run), on the environment in .venv.
bin := .venv/bin

.PHONY: check format lint types imports test demo bench lock
.DEFAULT_GOAL := check

check: format lint types imports test

format: ## the code is formatted
	$(bin)/ruff format --check

lint: ## no rule is broken
	$(bin)/ruff check

types: ## every annotation holds
	$(bin)/mypy

imports: ## imports run one way
	$(bin)/lint-imports

test: ## all rings, in bounded form
	$(bin)/pytest

demo: ## everything on this machine, with a scripted teacher
	$(bin)/sfid demo

bench: ## the figures of the README
	$(bin)/pytest tests/benchmarks -q -s

# The lock names versions and hashes and no index, so that it installs from any mirror.
# The second one is for images of services that do not watch: it leaves out the viewer.
compile := $(bin)/uv pip compile pyproject.toml --all-extras --universal --python-version 3.11 \
	--generate-hashes --no-emit-index-url --no-emit-find-links --no-header --quiet

lock: ## requirements*.lock, made anew from pyproject.toml
	$(bin)/pip install --quiet uv
	echo done

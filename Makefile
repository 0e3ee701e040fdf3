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
	for name in sokoban_step live_step boxoban_levels label_latency decisions experiment crowd \
		page_participants sessions; do \
		echo "== $$name" && $(bin)/python tests/benchmarks/$$name.py || exit 1; done

# The locks name versions and hashes and no index, so that they install from any mirror.
#   requirements.lock           everything: all extras and what the tests need
#   requirements-monitor.lock   an image that watches
#   requirements-services.lock  an image that does not watch: without the viewer and what only the viewer needs
pin = build/lock/bin/uv pip compile pyproject.toml --quiet --universal --python-version 3.11 \
	--generate-hashes --no-emit-index-url --no-header --no-annotate --output-file

lock: ## requirements*.lock, made anew from pyproject.toml
	python3 -m venv build/lock
	build/lock/bin/pip install --quiet uv
	rm -f requirements*.lock
	echo "rerun-sdk; python_version < '3'" >build/lock/without-viewer.txt
	$(pin) requirements.lock --all-extras
	$(pin) requirements-monitor.lock --constraints requirements.lock --extra metrics
	$(pin) requirements-services.lock --constraints requirements.lock --extra metrics \
		--overrides build/lock/without-viewer.txt

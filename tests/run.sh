#!/usr/bin/env bash
# make test: all tests of the workspace, then where the time went, the table of figures that were wanted, and one line of all
# results. Arguments go to `cargo test`. The status is 1 where a test failed or a row of the table is out of its bound or missing.
set -uo pipefail
cd "$(dirname "$0")/.."
log=target/test.log
rm -rf target/wanted
mkdir -p target

status=0
cargo test --workspace --locked --no-fail-fast "$@" 2>&1 | tee "$log" || status=1
echo
echo "Slowest test programs, seconds:"
awk '$1 == "Running" || $1 == "Doc-tests" { name = $2 == "unittests" ? $3 " (unit tests)" : $2 }
    /^test result:/ && match($0, /finished in [0-9.]+/) { printf "%8.1f  %s\n", substr($0, RSTART + 12, RLENGTH - 12), name }' "$log" |
    sort -rn | head -n 12
times >target/test.times
echo "Processor time with compiling (user, system): $(tail -n 1 target/test.times)"
awk -v reached=target/wanted -f tests/wanted.awk tests/wanted.tsv || status=1
# What cargo said last, once more after the table: which test programs failed.
awk '/^test result:/ { passed += $4; failed += $6; ignored += $8 }
    /^error: [0-9]+ target/ { closing = 1 }
    closing { print }
    /^test .*FAILED$/ { print }
    END { printf "%d tests passed, %d failed, %d ignored\n", passed, failed, ignored }' "$log"
[ "$status" = 0 ] || echo "FAILED: see the tests and the figures above; the whole log is $log"
exit "$status"

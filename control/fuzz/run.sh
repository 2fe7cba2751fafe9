#!/bin/sh
# Fuzzes the map loader, microstepping and every controller: control/fuzz/run.sh [RUNS] [JOBS]. RUNS executions of each, a few thousand
# by default; JOBS targets at a time. SEED=0 draws a seed; else it is 1, so that what passes here passes again. Findings and
# corpora stay in build/fuzz.
set -eu
cd "$(dirname "$0")/../.."
runs=${1:-100000}
jobs=${2:-2}
clang=$(command -v clang || command -v clang-14 || true)
here=control/fuzz
out=build/fuzz
if [ -z "$clang" ] || ! echo 'int LLVMFuzzerTestOneInput(const char *d, long n) { return d[n - 1]; }' \
    | "$clang" -fsanitize=fuzzer -x c -o /dev/null - 2>/dev/null; then
  echo "make fuzz needs clang with libFuzzer (Debian: clang libclang-rt-14-dev)" >&2
  exit 2
fi
mkdir -p "$out"

compile() { # flags, sources
  "$clang" -g -O2 -std=c99 -ffp-contract=off -fsanitize=fuzzer,address,undefined,float-cast-overflow \
    -fno-sanitize-recover=all -Wall -Wextra -Wconversion -Icontrol/src -Icontrol/tests -Icontrol/harness "$@"
}

library() { # name, flags: once for all targets that link its objects
  objects=$out/$1.objects
  shift
  rm -rf "$objects"
  mkdir "$objects"
  for source in control/src/cogless/*.c; do
    compile "$@" -c "$source" -o "$objects/$(basename "$source" .c).o"
  done
}

build() { # name, library, flags and sources
  name=$1 objects=$out/$2.objects
  shift 2
  compile "$@" "$objects"/*.o -o "$out/$name"
}

fuzz() { # name
  mkdir -p "$out/$1.corpus"
  begin=$(date +%s)
  if ! "$out/$1" -runs="$runs" -seed="${SEED:-1}" -max_len=512 -len_control=0 -entropic=0 -timeout=10 \
      -artifact_prefix="$out/$1-" "$out/$1.corpus" >"$out/$1.log" 2>&1; then
    printf '%-24s FAILED\n' "$1"
    grep -E -m3 '^control/|runtime error|ERROR: Add' "$out/$1.log" || tail -n 5 "$out/$1.log"
    return 1
  fi
  done=$(sed -n 's/^Done \([0-9]*\) runs.*/\1/p' "$out/$1.log")
  printf '%-24s %12s executions %6s s, no finding\n' "$1" "$done" $(($(date +%s) - begin))
}

if [ "${3:-}" ]; then # one target, for xargs below
  fuzz "$3"
  exit
fi
# Comparisons, when traced, show the fuzzer a map's magic numbers. A controller compares numbers that were scaled: there they show
# nothing and take half the time. So does -entropic, which weighs inputs by how rare is what they reach.
library single
library double -DCOGLESS_DOUBLE
library untraced -fno-sanitize-coverage=trace-cmp
build map_store single "$here/feed.c" "$here/map_store.c"
build map_store-double double -DCOGLESS_DOUBLE "$here/feed.c" "$here/map_store.c"
build microstepping untraced -fno-sanitize-coverage=trace-cmp "$here/feed.c" "$here/microstepping.c"
names="map_store map_store-double microstepping"
for law in control/harness/*.c; do
  name=$(basename "$law" .c)
  if [ "$name" != harness ]; then # few cells, so that few bytes fill a map; memory without fences, which the sanitizer has
    build "$name" untraced -fno-sanitize-coverage=trace-cmp -DHARNESS="harness_$name" -DCELLS_MAX=40U -DFENCE=0U \
      "$here/feed.c" "$here/controller.c" control/harness/harness.c "$law"
    names="$names $name"
  fi
done
for name in $names; do echo "$name"; done | xargs -P "$jobs" -I{} "$0" "$runs" "$jobs" {}

# What ran where, as a table: on GitHub in the summary of the run, else printed at the end. To be sourced.
scratch=$(mktemp -d)
table=${GITHUB_STEP_SUMMARY:-$scratch/table}
trap '[ -n "${GITHUB_STEP_SUMMARY-}" ] || cat "$table"; rm -rf "$scratch"' EXIT
[ -s "$table" ] || printf '| where | what came of it |\n|---|---|\n' > "$table"

ran() { # WHERE COMMAND...: run it, and note its last line
  local where=$1 status=0 said
  shift
  said=$(mktemp -p "$scratch")
  "$@" 2>&1 | tee "$said" || status=$?
  printf '| %s | %s |\n' "$where" "$(tail -n 1 "$said" | tr -d '=|')" >> "$table"
  return $status
}

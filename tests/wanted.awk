# Prints wanted / reached / bound of every row of tests/wanted.tsv, from what tests wrote to a folder of reached figures:
#   awk -v reached=target/wanted -f tests/wanted.awk tests/wanted.tsv
# The status is 1 where a row is above its bound, or was not reached although no test was skipped.
BEGIN { FS = "\t"; skipped = (getline line < (reached "/SKIPPED.tsv")) > 0 }
NR == 1 { next }
{
    id[++rows] = $1; wanted[rows] = $3; bound[rows] = $4; unit[rows] = $5; cause[rows] = $6
    if (length($1) > wide) wide = length($1)
    file = reached "/" $1 ".tsv"
    most[rows] = -1
    while ((getline line < file) > 0) {
        split(line, cells, "\t")
        if (cells[2] + 0 > most[rows]) most[rows] = cells[2] + 0
        # What is no number is above every bound.
        if (cells[2] !~ /^[0-9]/) most[rows] = "NaN"
    }
    close(file)
}
END {
    printf "\n%-" wide "s  %9s %9s %9s  %s\n", "figure", "wanted", "reached", "bound", "unit"
    for (i = 1; i <= rows; i++) {
        if (most[i] == "NaN") { verdict = "ABOVE ITS BOUND"; above++; shown = "NaN" }
        else if (most[i] < 0) { verdict = "NOT REACHED"; missing++; shown = "-" }
        else {
            shown = sprintf("%.4g", most[i])
            if (most[i] > bound[i] + 0) { verdict = "ABOVE ITS BOUND"; above++ }
            else if (most[i] > wanted[i] + 0) { verdict = "missed: " (cause[i] == "" ? "not found" : cause[i]); missed++ }
            else { verdict = ""; met++ }
        }
        printf "%-" wide "s  %9s %9s %9s  %s%s\n", id[i], wanted[i], shown, bound[i], unit[i], verdict == "" ? "" : "  " verdict
    }
    printf "%d figures: %d as wanted, %d missed within their bound, %d above it, %d not reached%s\n", rows, met, missed, above, missing, \
        missing && skipped ? " (tests were skipped)" : ""
    exit (above || (missing && !skipped)) ? 1 : 0
}

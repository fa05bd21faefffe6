#!/bin/sh
# Seeds for the fuzz targets: the recordings of the tests, and small captures of a simulated slave.
# Usage: fuzz/seeds.sh [BISS], from the top of the project.
set -eu
biss=${1:-target/debug/biss}
corpus=fuzz/corpus
made=$(mktemp -d)
trap 'rm -rf "$made"' EXIT
mkdir -p $corpus/vcd $corpus/csv $corpus/sr $corpus/raw $corpus/file

for link in sim:seed=1 sim:seed=2,delay=4.2us,busy=3us,crc-error=20% sim:seed=3,frame=mt12,st20,nE,nW,crc6; do
    for kind in vcd csv sr; do
        "$biss" capture "$link" -q -n 4 -w "$made/$(echo "$link" | tr -c 'a-z0-9\n' _).$kind" || [ $? = 1 ]
    done
done

# The first byte says how a target takes what follows: as it is.
seed() {
    { printf "$2"; head -c 65535 "$1"; } >"$corpus/$3/$(basename "$1").$4"
}
for file in tests/recordings/* "$made"/*; do
    case $file in
    *.vcd) seed "$file" '\000' vcd 0 ;;
    *.csv) seed "$file" '\000' csv 0 ;;
    *.sr) seed "$file" '\000' sr 0 ;;
    *.bin) head -c 65536 "$file" >"$corpus/raw/$(basename "$file")" ;;
    *) continue ;;
    esac
    case $file in
    *.bin) seed "$file" '\013' file 0 && seed "$file" '\011' file 1 ;;
    *) seed "$file" '\000' file 0 && seed "$file" '\020' file 1 && seed "$file" '\100' file 2 ;;
    esac
done

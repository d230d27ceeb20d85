#!/bin/sh
# Fetch the page's libraries from the npm registry into the repository, with their licences. Run by hand to update them.
set -eu
cd "$(dirname "$0")/.."
into=executive/dashboard/static/vendor
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
npm pack --silent --pack-destination "$work" uplot@1.6.32 >/dev/null
tar xzf "$work"/uplot-*.tgz -C "$work"
cp "$work/package/dist/uPlot.esm.js" "$into/uplot.js"
cp "$work/package/dist/uPlot.min.css" "$into/uplot.css"
cp "$work/package/LICENSE" "$into/uplot.LICENSE"

#!/bin/sh
# Fetch the page's libraries from the npm registry into the repository, with their licences. Run by hand to update them.
set -eu
cd "$(dirname "$0")/.."
into=executive/pomona/tools/dashboard/static/vendor
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
npm pack --silent --pack-destination "$work" uplot@1.6.32 >/dev/null
tar xzf "$work"/uplot-*.tgz -C "$work"
cp "$work/package/dist/uPlot.esm.js" "$into/uplot.js"
cp "$work/package/dist/uPlot.min.css" "$into/uplot.css"
cp "$work/package/LICENSE" "$into/uplot.LICENSE"

# Of three.js what static/scene.js uses, as one module.
npm pack --silent --pack-destination "$work" three@0.187.0 >/dev/null
mkdir -p "$work/node_modules/three"
tar xzf "$work"/three-*.tgz --strip-components=1 -C "$work/node_modules/three"
cat >"$work/three.js" <<'EXPORTS'
export { AmbientLight, Box3, BoxGeometry, BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, Group, GridHelper, InstancedMesh, Matrix4, Mesh, MeshLambertMaterial, PerspectiveCamera, Points, PointsMaterial, Raycaster, Scene, Sphere, Vector2, Vector3, WebGLRenderer } from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
export { Line2 } from "three/examples/jsm/lines/Line2.js";
export { LineGeometry } from "three/examples/jsm/lines/LineGeometry.js";
export { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
EXPORTS
npx --yes esbuild@0.25.10 "$work/three.js" --bundle --minify --format=esm --legal-comments=inline --outfile="$into/three.js"
cp "$work/node_modules/three/LICENSE" "$into/three.LICENSE"

# What the documentation's search needs in pages that are opened from the disk.
npm pack --silent --pack-destination "$work" iframe-worker@1.0.4 >/dev/null
mkdir -p "$work/iframe-worker"
tar xzf "$work"/iframe-worker-*.tgz --strip-components=1 -C "$work/iframe-worker"
cp "$work/iframe-worker/shim/index.js" docs/assets/iframe-worker.js
cp "$work/iframe-worker/LICENSE" docs/assets/iframe-worker.LICENSE

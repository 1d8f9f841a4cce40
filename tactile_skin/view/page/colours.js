// SPDX-License-Identifier: Apache-2.0
// Colour scales: perceptually uniform, and told apart by the colour-blind.

// viridis of matplotlib, at 16 places
const VIRIDIS = [
  "#440154", "#481a6c", "#472f7d", "#414487", "#39568c", "#31688e", "#2a788e", "#23888e",
  "#1f988b", "#22a884", "#35b779", "#54c568", "#7ad151", "#a5db36", "#d2e21b", "#fde725",
];
const BELOW = "#2f7fd6"; // of a misfit: the reading is below the model
const ABOVE = "#e06a00";

/** A colour as #rrggbb -> [red, green, blue], 0 to 255. */
export const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));

/** 256 colours through the given ones, as (256 * 4) bytes. */
function table(stops) {
  const known = stops.map(rgb);
  const bytes = new Uint8ClampedArray(1024);
  for (let k = 0; k < 256; k++) {
    const at = (k / 255) * (known.length - 1);
    const low = Math.min(Math.floor(at), known.length - 2);
    for (let c = 0; c < 3; c++) {
      bytes[4 * k + c] = known[low][c] + (at - low) * (known[low + 1][c] - known[low][c]);
    }
    bytes[4 * k + 3] = 255;
  }
  return bytes;
}

/** From 0 to the scale's end. */
export const rising = table(VIRIDIS);

/** From minus the scale's end to the end; `middle` is the colour of the page. */
export const signed = (middle) => table([BELOW, middle, ABOVE]);

const ENDS = [1, 1.5, 2, 3, 4, 5, 7.5, 10]; // of a scale, times a power of ten

/** The smallest end of a scale that is not below x. */
export function roundUp(x) {
  const decade = 10 ** Math.floor(Math.log10(x));
  return ENDS.map((k) => k * decade).find((end) => end >= x * 0.9999);
}

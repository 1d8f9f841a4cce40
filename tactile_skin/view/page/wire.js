// SPDX-License-Identifier: Apache-2.0
// A message of the server: numbers and arrays (see pictures.py).

const ARRAYS = { "<f4": Float32Array, "<u2": Uint16Array, "|u1": Uint8Array };

/** ArrayBuffer -> {head, arrays: name -> typed array, row by row}. */
export function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const arrays = {};
  let at = 4 + length;
  for (const [name, dtype, shape] of head.arrays) {
    const count = shape.reduce((a, b) => a * b, 1);
    arrays[name] = new ARRAYS[dtype](buffer, at, count);
    at += Math.ceil((count * ARRAYS[dtype].BYTES_PER_ELEMENT) / 4) * 4;
  }
  return { head, arrays };
}

// Reads a rigcast frame, version 1 (docs/wire.md), in Node and in the browser.
// node frame.mjs < message prints it; exit 1 where it is not one.

function crc32(bytes) {
  let crc = ~0;
  for (const byte of bytes) {
    crc ^= byte;
    for (let k = 0; k < 8; k++) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return ~crc >>> 0;
}

// The frame in `bytes` (Uint8Array), or null where they are not a whole one. Arrays are row by row.
export function frame(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength), n = bytes.length;
  if (n < 68 || view.getUint32(0) !== 0x52494746 || bytes[4] !== 1 || bytes[5] > 3 || bytes[7] > 1) return null;
  const joints = view.getUint16(12, true), samples = view.getUint16(14, true), torque = bytes[7] * joints;
  if (joints < 1 || joints > 128 || samples < 1 || samples > 256) return null;
  if (n !== 68 + 4 * (samples * (2 * joints + 8) + torque)) return null;
  if (view.getUint32(n - 4, true) !== crc32(bytes.subarray(0, n - 4))) return null;
  let at = 64;
  const take = (count, read) => Array.from({ length: count }, () => [view[read](at, true), (at += 4)][0]);
  return {
    stream: view.getUint32(8, true), seq: view.getBigUint64(16, true), state: bytes[5], joints, samples,
    rigHash: view.getBigUint64(24, true), reportId: view.getBigUint64(32).toString(16).padStart(16, "0"),
    captureNs: view.getBigUint64(40, true), dueNs: view.getBigUint64(48, true), periodNs: view.getBigUint64(56, true),
    pos: take(samples * joints, "getFloat32"), vel: take(samples * joints, "getFloat32"),
    root: take(samples * 7, "getFloat32"), torque: take(torque, "getFloat32"), contacts: take(samples, "getUint32"),
  };
}

if (typeof process !== "undefined" && process.argv?.[1]?.endsWith("frame.mjs")) {
  const found = frame(new Uint8Array((await import("node:fs")).readFileSync(0)));
  if (found === null) process.exit(1);
  console.log(JSON.stringify(found, (_, value) => (typeof value === "bigint" ? String(value) : value)));
}

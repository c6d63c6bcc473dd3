"use strict";
// Masking sound: noise made in the page and looped, from the first key press on, without which browsers play no sound.
// kind: none, white, pink.
class MaskingNoise {
  constructor(kind) { this.kind = kind; this.context = null; }

  start() {
    if (this.kind === "none" || this.context !== null) return;
    this.context = new AudioContext();
    const count = this.context.sampleRate * 8;
    const buffer = this.context.createBuffer(1, count, this.context.sampleRate);
    const data = buffer.getChannelData(0);
    this.kind === "pink" ? MaskingNoise.pink(data) : MaskingNoise.white(data);
    const source = this.context.createBufferSource();
    source.buffer = buffer;
    source.loop = true;
    source.connect(this.context.destination);
    source.start();
  }

  stop() {
    if (this.context !== null) { this.context.close(); this.context = null; }
  }

  static white(data) {
    for (let i = 0; i < data.length; i++) data[i] = 0.2 * (2 * Math.random() - 1);
  }

  // Voss's method: the sum of rows of random numbers, of which row k is renewed every 2^k samples.
  static pink(data) {
    const rows = new Array(12).fill(0);
    let sum = 0;
    for (let i = 0; i < data.length; i++) {
      const row = Math.min(11, Math.clz32(0) - 1 - Math.clz32((i + 1) & -(i + 1)));
      const fresh = 2 * Math.random() - 1;
      sum += fresh - rows[row];
      rows[row] = fresh;
      data[i] = 0.2 * sum / 4;
    }
  }
}

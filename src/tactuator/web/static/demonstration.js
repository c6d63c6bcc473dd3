"use strict";
// Draws the stimulus of a simulated display, where nothing can be felt, as large as it would be felt, and plays it as
// sound where that is wished. envelope_db_sl: a value each step_s; frequency_hz where there is one.
class Demonstration {
  constructor(canvas, sound) {
    Object.assign(this, { canvas, sound, shape: null, began: 0, context: null, source: null });
    sound.onclick = () => this.listen(this.context === null);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw(0));
  }

  listen(on) {
    if (on) this.context = new AudioContext(); else { this.context.close(); this.context = this.source = null; }
    this.sound.setAttribute("aria-pressed", String(on));
    this.sound.textContent = word(on ? "sound_off" : "sound_on");
  }

  // Starts to show what an interval plays.
  play(shape) {
    Object.assign(this, { shape, began: performance.now() });
    if (this.context !== null) this.tone(shape);
    requestAnimationFrame(() => this.step());
  }

  // Ends what is shown and heard.
  stop() {
    this.source?.stop();
    this.shape = this.source = null;
  }

  level(seconds) {
    if (this.shape === null) return null;
    const values = this.shape.envelope_db_sl, at = Math.floor(seconds / this.shape.step_s);
    return at >= 0 && at < values.length ? values[at] : null;
  }

  step() {
    const seconds = (performance.now() - this.began) / 1000;
    const level = this.level(seconds);
    this.draw(level === null ? 0 : Demonstration.height(level), seconds);
    if (level !== null) requestAnimationFrame(() => this.step());
  }

  // Returns pixels: about one at threshold, where it is as hard to see as it would be to feel; full height at 50 dB SL.
  static height(level) { return Math.min(56, Math.pow(10, level / 28)); }

  draw(height, seconds = 0) {
    const pen = this.canvas.getContext("2d"), { width, height: tall } = this.canvas;
    pen.clearRect(0, 0, width, tall);
    pen.strokeStyle = getComputedStyle(this.canvas).color;
    pen.lineWidth = 2 * Math.max(1, width / Math.max(1, this.canvas.clientWidth)); // the same thickness on a phone
    pen.beginPath();
    const waves = 3 + 3 * Math.log10(Math.max(1, this.shape === null ? 1 : this.shape.frequency_hz || 50));
    for (let x = 0; x <= width; x += 2) {
      pen.lineTo(x, tall / 2 - height * Math.sin(2 * Math.PI * (waves * x / width - 3 * seconds)));
    }
    pen.stroke();
  }

  tone({ envelope_db_sl: levels, step_s: step, frequency_hz: frequency }) {
    const gain = this.context.createGain(), source = this.context.createOscillator(), now = this.context.currentTime;
    source.frequency.value = Math.max(frequency || 200, 60);
    gain.gain.setValueAtTime(0, now);
    levels.forEach((level, i) => gain.gain.linearRampToValueAtTime(level <= -60 ? 0 : Math.min(0.5, 0.002 * Math.pow(10, level / 20)), now + (i + 1) * step));
    gain.gain.linearRampToValueAtTime(0, now + (levels.length + 1) * step);
    source.connect(gain).connect(this.context.destination);
    source.start(now);
    source.stop(now + (levels.length + 1) * step);
    this.source = source;
  }
}

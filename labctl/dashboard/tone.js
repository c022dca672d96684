"use strict";
// A tone whose pitch follows the level of one port, for somebody who looks at the fibre and not at the screen.
const labctlTone = {
  row: 0,
  sound: null,
  toggle() {
    if (this.sound) {
      this.sound.context.close();
      this.sound = null;
    } else {
      const context = new AudioContext(), source = context.createOscillator(), volume = context.createGain();
      source.connect(volume).connect(context.destination);
      source.start();
      this.sound = { context, source, volume };
      this.follow();
    }
    for (const button of document.querySelectorAll(".tone")) button.setAttribute("aria-pressed", String(!!this.sound));
  },
  follow() {
    if (!this.sound) return;
    const tones = document.querySelector("[data-tones]")?.dataset.tones.split(",").map(Number) ?? [];
    const pitch = tones[this.row];
    this.sound.volume.gain.value = document.querySelector(".old-region")?.textContent ? 0 : 0.1;
    if (pitch) this.sound.source.frequency.setTargetAtTime(pitch, this.sound.context.currentTime, 0.03);
    setTimeout(() => this.follow(), 50);
  },
};

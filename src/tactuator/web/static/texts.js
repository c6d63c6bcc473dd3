"use strict";
// The page's texts in its language. word("wrong", {right: "2"}) puts values in.
let TEXTS = {};
const readTexts = () => { TEXTS = JSON.parse(el("words").textContent); };
const word = (key, values = {}) => TEXTS[key].replace(/\{(\w+)\}/g, (whole, name) => (name in values ? String(values[name]) : whole));
readTexts();

// Mechanisms in frames have the colours of the page around them.
const paint = () => {
  for (const frame of document.querySelectorAll("iframe.moving")) {
    const at = new URL(frame.src), words = new URLSearchParams(at.hash.slice(1));
    words.set("theme", document.documentElement.dataset.theme);
    at.hash = words;
    if (frame.src !== at.href) frame.src = at.href;
  }
};
new MutationObserver(paint).observe(document.documentElement, {attributeFilter: ["data-theme"]});
document.addEventListener("DOMContentLoaded", paint);

// Runs before the first paint, so that a chosen theme does not flash in the other one. Not a module for that reason.
(() => {
  "use strict";
  try {
    const chosen = localStorage.getItem("nacre-theme");
    if (chosen === "light" || chosen === "dark") document.documentElement.dataset.theme = chosen;
  } catch {
    // Storage can be forbidden; the theme of the system is then used.
  }
})();

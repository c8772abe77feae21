/** The screen: full screen, and a check of window and keyboard before a run begins. */

import { button, element, setText } from "./dom.js";
import { t } from "./language.js";

/** The smallest window in which nothing of a run with a task has to be scrolled [px]. */
const LEAST = { width: 1280, height: 700 };

let hasKeyboard = false;

export function startScreen() {
  const whole = button("full-screen");
  whole.hidden = !document.fullscreenEnabled;
  whole.addEventListener("click", () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen()));
  window.addEventListener("resize", check);
  window.addEventListener(
    "keydown",
    () => {
      hasKeyboard = true;
      check();
    },
    true,
  );
  check();
}

/** Say on the sheet what is not as it should be. */
export function check() {
  const { innerWidth: width, innerHeight: height } = window;
  const isSmall = width < LEAST.width || height < LEAST.height;
  const size = t("This window is small: {width} × {height}. Make it larger, or use the full screen.", { width, height });
  setText(element("sheet-window"), isSmall ? size : "");
  setText(element("sheet-keyboard"), hasKeyboard ? t("The keyboard works.") : t("Press any key, to see that the keyboard works."));
}

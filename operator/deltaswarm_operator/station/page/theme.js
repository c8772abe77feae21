/** Dark or light: the machine's choice, unless chosen here. */

import { button, setText } from "./dom.js";
import { t } from "./language.js";
import { isDark } from "./looks.js";

const STORED = "deltaswarm-theme";

/** @param {() => void} onChange */
export function startTheme(onChange) {
  const stored = localStorage.getItem(STORED);
  if (stored === "dark" || stored === "light") document.documentElement.dataset["theme"] = stored;
  const show = () => {
    setText(button("theme"), isDark() ? t("Light") : t("Dark"));
    onChange();
  };
  button("theme").addEventListener("click", () => {
    const chosen = isDark() ? "light" : "dark";
    document.documentElement.dataset["theme"] = chosen;
    localStorage.setItem(STORED, chosen);
    show();
  });
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
  show();
}

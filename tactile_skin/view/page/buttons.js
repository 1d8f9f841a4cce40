// SPDX-License-Identifier: Apache-2.0
// Buttons: one that is pressed twice, and one that opens and closes something.

/** Within 4 s of the first time, the second is meant. */
export function twice(button, question, act) {
  const name = button.textContent;
  let timer = null;
  const calm = () => {
    clearTimeout(timer);
    timer = null;
    button.textContent = name;
    button.classList.remove("sure");
  };
  button.onclick = () => {
    if (timer === null) {
      button.textContent = question;
      button.classList.add("sure");
      timer = setTimeout(calm, 4000);
    } else {
      calm();
      act();
    }
  };
  button.onblur = calm;
}

/** Give a choice its options, [[value, text], ...]. */
export function fill(select, options, value) {
  select.replaceChildren(...options.map(([key, text]) => new Option(text, key)));
  select.value = value;
}

/** @param act called with whether it is open now. */
export function toggle(button, closed, opened, act) {
  button.onclick = () => {
    const open = button.getAttribute("aria-expanded") !== "true";
    button.setAttribute("aria-expanded", open);
    button.textContent = open ? opened : closed;
    act(open);
  };
}

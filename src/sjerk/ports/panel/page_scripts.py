"""What is added to viser's page: words that run before its own.

Never here: who gets the page (``door.py``).
"""

from __future__ import annotations

#: The page lets go of a held button when its window loses the focus, is hidden, or left.
WATCHFUL = b"""<script>(() => {
  let held = null;
  const drop = () => {
    const last = held;
    held = null;
    const gone = {bubbles: true, pointerId: last ? last.pointerId : 0};
    if (last) last.target.dispatchEvent(new PointerEvent('pointercancel', gone));
  };
  addEventListener('pointerdown', event => { held = event; }, true);
  addEventListener('pointerup', () => { held = null; }, true);
  for (const what of ['blur', 'contextmenu', 'pagehide']) addEventListener(what, drop);
  document.addEventListener('visibilitychange', () => { if (document.hidden) drop(); });
})();</script>"""

#: The page sends every value and every press, in their order. viser 1.1 sends one message in 50 ms
#: of all inputs and buttons together, and forgets all but the last that came meanwhile: of a name,
#: three numbers and a click within that time only the click arrives. (A page that draws for half a
#: second has all that was typed meanwhile "within that time".) The pause after a message is the
#: next timer of 50 ms that is asked for once it is sent: it is over at once.
FAITHFUL = b"""<script>(() => {
  const later = window.setTimeout.bind(window), PAUSE = 50;
  let sent = false, mutable;
  window.setTimeout = (work, after, ...more) => {
    if (!sent || after !== PAUSE) return later(work, after, ...more);
    sent = false;
    work();
    return 0;
  };
  const watch = page => {
    let send = page.sendMessage;
    const told = message => {
      send(message);
      sent = true;
      queueMicrotask(() => { sent = false; });
    };
    Object.defineProperty(page, 'sendMessage', {
      configurable: true, enumerable: true,
      get: () => send === null ? null : told,
      set: another => { send = another; },
    });
  };
  Object.defineProperty(window, '__viserMutable', {
    configurable: true, enumerable: true,
    get: () => mutable,
    set: page => { if (page && page !== mutable) watch(page); mutable = page; },
  });
})();</script>"""

SCRIPTS = WATCHFUL + FAITHFUL

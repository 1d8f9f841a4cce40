// SPDX-License-Identifier: Apache-2.0
// The WebSocket: one snapshot is asked for at a time, so that nothing waits in a queue.

import { unpack } from "./wire.js";

const RETRY = 1000; // ms until a lost connection is tried again

/** What the address behind its # gives who may steer from another computer; kept for this tab. */
export const token = location.hash.slice(1) || sessionStorage.getItem("token") || "";
if (token) sessionStorage.setItem("token", token);

export class Connection {
  /**
   * @param listener with hello(hello), snapshot(head, arrays), said(answer), lost(why).
   * @param skin of a body: its name behind a question mark, as in its page's address.
   */
  constructor(listener, skin = location.search) {
    Object.assign(this, { listener, skin });
    this.open();
  }

  open() {
    this.asked = false;
    this.socket = new WebSocket(`ws://${location.host}/snapshots${this.skin}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = ({ data }) => this.take(data);
    this.socket.onclose = ({ reason }) => {
      this.listener.lost(reason);
      setTimeout(() => this.open(), RETRY);
    };
  }

  take(data) {
    if (data instanceof ArrayBuffer) {
      this.asked = false;
      const { head, arrays } = unpack(data);
      this.listener.snapshot(head, arrays);
      return;
    }
    const said = JSON.parse(data);
    if (said.hello) this.listener.hello(said.hello);
    else this.listener.said(said.said);
  }

  /** Ask for a snapshot, unless one is on its way; whether it was asked for. */
  want(wanted) {
    if (this.asked || this.socket.readyState !== WebSocket.OPEN) return false;
    this.asked = true;
    this.socket.send(JSON.stringify(wanted));
    return true;
  }

  ask(ask, text = "") {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ ask, text, token }));
  }
}

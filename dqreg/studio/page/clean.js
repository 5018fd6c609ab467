export function enter() {}
export function panel() { return []; }

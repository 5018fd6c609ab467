// Questions to the server. Addresses are relative: the key is part of the page's own.
const base = location.pathname.endsWith("/") ? location.pathname : location.pathname + "/";

// What went wrong, in a sentence; `file` of the visit says more where it was a mistake of the program.
export class Trouble extends Error { constructor(words, file) { super(words); this.file = file; } }
export class Stopped extends Error {}

const SILENT = "The studio does not answer. If its terminal was closed, start dqreg studio again.";

export async function ask(path, { method = "GET", body } = {}) {
  let answer;
  try {
    answer = await fetch(base + path, { method, body: body === undefined ? undefined : JSON.stringify(body) });
  } catch { throw new Trouble(SILENT); }
  const json = (answer.headers.get("content-type") ?? "").includes("json") ? await answer.json() : null;
  if (json?.stopped) throw new Stopped();
  if (!answer.ok) throw new Trouble(json?.error ?? `The studio refused this (${answer.status}).`, json?.file);
  return json;
}
export const send = (path, body = {}) => ask(path, { method: "POST", body });

export async function fetchBytes(path) {
  let answer;
  try { answer = await fetch(base + path); } catch { throw new Trouble(SILENT); }
  if (!answer.ok) throw new Trouble(`The drawing is not there (${answer.status}).`);
  return answer.arrayBuffer();
}

export function upload(path, file, progress) {
  return new Promise((done, fail) => {
    const request = new XMLHttpRequest();
    request.open("PUT", base + path);
    request.upload.onprogress = e => { if (e.lengthComputable) progress(e.loaded / e.total); };
    request.onerror = () => fail(new Trouble(`${file.name} could not be sent. Is the studio still running, and the file still there?`));
    request.onload = () => {
      let json = null;
      try { json = JSON.parse(request.responseText); } catch { /* said below */ }
      if (request.status === 200) done(json);
      else fail(new Trouble(json?.error ?? `The studio refused this file (${request.status}).`, json?.file));
    };
    request.send(file);
  });
}

export const address = path => base + path;
export const events = path => new EventSource(base + path);

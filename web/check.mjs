// After the build: the page stays small, whole and free of inline code.
import { existsSync, readFileSync, readdirSync } from "node:fs";
import { gzipSync } from "node:zlib";

const STATIC = new URL("../server/static/", import.meta.url);
const LIMIT = 250_000;

const files = readdirSync(new URL("assets/", STATIC)).filter((name) => /\.(js|css)$/.test(name));
const bytes = files.map((name) => gzipSync(readFileSync(new URL(`assets/${name}`, STATIC)), { level: 9 }).length);
const total = bytes.reduce((sum, one) => sum + one, 0);
const html = readFileSync(new URL("index.html", STATIC), "utf8");

const faults = [];
if (total > LIMIT) faults.push(`the bundle is ${total} bytes gzipped, more than ${LIMIT}`);
if (/<script(?![^>]*\bsrc=)|\sstyle=|\son[a-z]+=/.test(html)) faults.push("index.html holds inline code or styles");
if (/https?:\/\/(?!www\.w3\.org)/.test(html)) faults.push("index.html names another host");
if (!existsSync(new URL("third-party.md", STATIC))) faults.push("third-party.md is missing");

if (faults.length) {
  console.error(`page: ${faults.join("; ")}`);
  process.exit(1);
}
console.log(`page: ${files.length} files, ${(total / 1000).toFixed(1)} kB gzipped (at most ${LIMIT / 1000})`);

"""How the page about a bag looks: on a screen by day and night, on a phone, on paper."""

STYLE = """
:root { color-scheme: light dark; --ink: #1c1f24; --soft: #5b6470; --paper: #ffffff;
  --line: #dfe3e8; --card: #f6f7f9; --good: #1a7f4b; --poor: #b2182b; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e8eb; --soft: #9aa4b1; --paper: #15181c; --line: #2e343c; --card: #1d2126;
    --good: #4cc38a; --poor: #ff7b86; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 60rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0.5rem 0; overflow-wrap: anywhere; }
h2 { font-size: 1.1rem; margin: 2.5rem 0 0.5rem; }
.lead { color: var(--soft); margin: 0 0 1.5rem; }
.badge { font-size: 0.8rem; font-weight: 600; padding: 0.15rem 0.6rem; border-radius: 1rem;
  border: 1px solid; vertical-align: middle; white-space: nowrap; }
.good, .ok { color: var(--good); }
.poor, .bad { color: var(--poor); }
.ok, .bad { font-weight: 600; }
.alert { border-left: 4px solid var(--poor); background: var(--card); padding: 0.1rem 1rem;
  margin: 1rem 0; overflow-wrap: anywhere; }
.alert h2 { margin-top: 0.75rem; }
.alert ul { padding-left: 1.2rem; }
figure { margin: 2rem 0; break-inside: avoid; }
img { display: block; width: 100%; height: auto; background: #ffffff;
  border: 1px solid var(--line); border-radius: 6px; }
figcaption { color: var(--soft); font-size: 0.9rem; margin-top: 0.4rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 0.9rem;
  font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 0.3rem 1rem 0.3rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; }
th { font-weight: 500; }
thead th { color: var(--soft); }
.number { text-align: right; white-space: nowrap; }
.kind th { color: var(--soft); font-size: 0.8rem; padding-top: 1rem; }
@media print { body { font-size: 10pt; } main { max-width: none; padding: 0; }
  tr { break-inside: avoid; } h2 { break-after: avoid; } .wide { overflow: visible; } }
"""

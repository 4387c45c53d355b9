"""How a report looks."""

STYLE = """
:root { color-scheme: light; --line: #d9dde3; --faint: #5c6670; --good: #1a7f4b; --bad: #b3261e; }
body { margin: 0; background: #f4f5f7; color: #1c2126; font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 28px 24px 60px; }
h1 { margin: 0 0 4px; font-size: 28px; }
h2 { margin: 0 0 12px; font-size: 18px; }
section { margin-top: 20px; padding: 18px 20px; background: #fff; border: 1px solid var(--line); border-radius: 8px; }
.status { margin: 0 0 16px; color: var(--faint); }
.pill { margin-right: 8px; padding: 2px 10px; border-radius: 12px; color: #fff; font-weight: 600; }
.pill.good { background: var(--good); }
.pill.bad { background: var(--bad); }
em.bad { color: var(--bad); }
.cards { display: flex; flex-wrap: wrap; gap: 12px; }
.card { flex: 1 1 150px; padding: 10px 14px; background: #fff; border: 1px solid var(--line); border-radius: 8px; }
.card b { font-size: 24px; }
.card small { display: block; color: var(--faint); }
.figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(320px, 1fr)); gap: 14px; }
figure { margin: 0; max-width: 780px; }
figure img, figure video { display: block; width: 100%; border: 1px solid var(--line); border-radius: 6px; }
figcaption { margin-top: 4px; color: var(--faint); text-align: center; }
.plots svg { display: block; width: 100%; height: auto; }
table { border-collapse: collapse; }
th, td { padding: 3px 14px 3px 0; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th { color: var(--faint); font-weight: 400; white-space: nowrap; }
td { font-variant-numeric: tabular-nums; }
pre { overflow-x: auto; padding: 12px; background: #f4f5f7; border-radius: 6px; font-size: 13px; line-height: 1.35; }
summary { cursor: pointer; }
@media print { body { background: #fff; } section { break-inside: avoid; } }
"""

"""The page of a report, as a template of jinja2.

Content-Security-Policy forbids the browser to load anything: all that the page needs is in it.
The picture is switched by boxes and buttons of HTML, not by plotly's legend, so that keyboard and
screen reader reach them.
"""

from __future__ import annotations

__all__ = ["PAGE"]

_STYLE = """
:root { color-scheme: light; --ink: #1d2129; --soft: #565e6b; --line: #d9dde3; --accent: #0072b2; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0; background: #f4f6f8; color: var(--ink); font: 16px/1.55 system-ui, sans-serif; }
main, footer { max-width: 66rem; margin: 0 auto; padding: 0 1rem; }
header { background: #12324a; color: #fff; }
header div { max-width: 66rem; margin: 0 auto; padding: 1.6rem 1rem 1.5rem; }
header p { margin: 0; color: #c5d6e3; font-size: .9rem; }
h1 { margin: .15rem 0 0; font-size: clamp(1.3rem, 4.5vw, 1.9rem); line-height: 1.25; overflow-wrap: anywhere;
  }
h2 { margin: 0 0 .6rem; font-size: 1.2rem; }
section { margin: 1.25rem 0; padding: 1.1rem 1.25rem 1.25rem; background: #fff; border: 1px solid var(--line);
  border-radius: 10px; }
section p { max-width: 46rem; margin: .6rem 0; }
.verdict { border-left: 6px solid var(--accent); }
.verdict p:first-of-type { font-size: 1.12rem; font-weight: 600; }
.soft { color: var(--soft); font-size: .9rem; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
caption { text-align: left; color: var(--soft); font-size: .9rem; padding-bottom: .5rem; }
th, td { padding: .45rem .6rem; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap;
  }
thead th { vertical-align: bottom; font-size: .85rem; color: var(--soft); font-weight: 600; white-space:
  normal; }
th:first-child, td.bar { text-align: left; }
tbody th { font-weight: 400; white-space: normal; }
tr.best th, tr.best td { font-weight: 700; background: #eef6fb; }
.badge { display: inline-block; margin-left: .4rem; padding: 0 .45rem; border-radius: 9px; background:
  var(--accent);
  color: #fff; font-size: .72rem; font-weight: 600; white-space: nowrap; vertical-align: .1em; }
td.bar { width: 24%; min-width: 7rem; }
td.bar svg { display: block; width: 100%; height: 20px; }
.controls { display: flex; flex-wrap: wrap; gap: .45rem; margin: .6rem 0; padding: 0; border: 0; min-width:
  0; }
.controls legend { padding: 0 0 .3rem; color: var(--soft); font-size: .9rem; }
.controls label, button { display: inline-flex; align-items: center; gap: .45rem; min-height: 2.4rem;
  padding: .25rem .75rem;
  border: 1px solid var(--line); border-radius: 8px; background: #fff; color: inherit; font: inherit;
  font-size: .9rem;
  cursor: pointer; overflow-wrap: anywhere; }
.controls label:hover, button:hover { border-color: var(--accent); }
.controls label:has(:checked) { background: #eef6fb; border-color: #9cc8e2; }
.controls svg { flex: none; width: 30px; height: 10px; }
:focus-visible { outline: 3px solid var(--accent); outline-offset: 2px; }
#picture { width: 100%; height: min(34rem, 82vh); min-height: 24rem; }
dl { display: grid; grid-template-columns: minmax(8rem, 14rem) 1fr; gap: .35rem 1rem; margin: 0; }
dt { color: var(--soft); }
dd { margin: 0; overflow-wrap: anywhere; }
dl.words { grid-template-columns: minmax(7rem, 11rem) 1fr; font-size: .95rem; }
footer { padding-top: .25rem; padding-bottom: 2rem; color: var(--soft); font-size: .85rem; }
@media (max-width: 46rem) {
  section { padding: .9rem .9rem 1rem; }
  table, tbody, tr, caption { display: block; }
  thead { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }
  tr { display: grid; grid-template-columns: 1fr 1fr; gap: 0 .5rem; padding: .7rem 0;
    border-bottom: 1px solid var(--line); }
  tr.best { margin: 0 -.9rem; padding-left: .9rem; padding-right: .9rem; background: #eef6fb; }
  th, td { border: 0; padding: .12rem 0; }
  tbody th, td.bar { grid-column: 1 / -1; font-weight: 600; width: auto; }
  td.number { display: flex; flex-direction: column; text-align: left; }
  td.number::before { content: attr(data-label); color: var(--soft); font-size: .8rem; font-weight: 400; }
  dl, dl.words { grid-template-columns: 1fr; gap: 0; }
  dd { margin-bottom: .5rem; }
}
@media print { body { background: #fff; } .controls { display: none; } section { break-inside: avoid; } }
"""

_SCRIPT = """
"use strict";
const read = (id) => JSON.parse(document.getElementById(id).textContent);
const picture = document.getElementById("picture");
const x = read("abscissa"), figure = read("figure"), view = read("view");
const touch = matchMedia("(pointer: coarse)").matches, small = innerWidth < 700, steps = x.length;
const width = small ? Math.ceil((view.end - view.begin) / 3) : view.end - view.begin;
for (const trace of figure.data) trace.x = x;
let begin = view.begin, end = view.begin + width;
figure.layout.xaxis.range = [x[begin], x[end - 1]];
figure.layout.xaxis.nticks = small ? 4 : 8;
figure.layout.dragmode = touch ? false : "zoom";  // a finger scrolls the page
Plotly.newPlot(picture, figure.data, figure.layout, {
  responsive: true, displaylogo: false, displayModeBar: touch ? false : "hover",
  modeBarButtons: [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
});
for (const box of document.querySelectorAll("input[data-traces]")) {
  box.addEventListener("change", () =>
    Plotly.restyle(picture, { visible: box.checked }, JSON.parse(box.dataset.traces)));
}
const show = (from, to) => {
  begin = Math.max(0, Math.min(from, steps - 1));
  end = Math.max(begin + 1, Math.min(to, steps));
  Plotly.relayout(picture, { "xaxis.range": [x[begin], x[end - 1]], "yaxis.autorange": true });
};
const shift = (by) => {
  const from = Math.max(0, Math.min(steps - width, begin + by));
  show(from, from + width);
};
const moves = {
  earlier: () => shift(-width), later: () => shift(width),
  excerpt: () => show(view.begin, view.begin + width), all: () => show(0, steps),
};
document.querySelector("button[data-move=excerpt]").textContent = `${width} steps`;
for (const button of document.querySelectorAll("button[data-move]")) {
  button.addEventListener("click", moves[button.dataset.move]);
}
"""

_TABLE = """
<table>
<caption>Errors of the state on the rows that no method has seen. The bars show the RMSE and its 95 %
  interval;
the dotted line is the error of always answering the mean of the learning part, {{ baseline_rmse }}{{ space
}}{{ unit }}.
</caption>
<thead><tr>
<th scope="col">method</th><th scope="col"><span class="soft">RMSE and interval</span></th>
{% for label in labels %}
<th scope="col">{{ label }}</th>
{% endfor %}
</tr></thead>
<tbody>
{% for row in rows %}
<tr{% if row.name == best %} class="best"{% endif %}>
<th scope="row">{{ row.name }}{% if row.name == best %} <span class="badge">lowest RMSE</span>{% endif %}</th>
<td class="bar"><svg viewBox="0 0 100 20" preserveAspectRatio="none" aria-hidden="true">
<line x1="{{ baseline }}" x2="{{ baseline }}" y1="0" y2="20" stroke="#8a93a0" stroke-dasharray="2 2"
 vector-effect="non-scaling-stroke"/>
<line x1="{{ row.bar.rmse_low }}" x2="{{ row.bar.rmse_high }}" y1="10" y2="10" stroke="#0072b2"
stroke-width="6"
 stroke-opacity=".35" vector-effect="non-scaling-stroke"/>
<line x1="{{ row.bar.rmse }}" x2="{{ row.bar.rmse }}" y1="3" y2="17" stroke="#0072b2" stroke-width="3"
 vector-effect="non-scaling-stroke"/>
</svg></td>
{% for label in labels %}
<td class="number" data-label="{{ label }}">{{ row.cells[loop.index0] }}</td>
{% endfor %}
</tr>
{% endfor %}
</tbody>
</table>
"""

_PICTURE = """
<noscript><p>The picture needs JavaScript; everything else on this page does not.</p></noscript>
<fieldset class="controls"><legend>Show</legend>
{% for layer in picture.layers %}
<label><input type="checkbox" data-traces="{{ layer.traces | tojson }}"{% if layer.is_shown %} checked{%
endif %}>
<svg viewBox="0 0 30 10" aria-hidden="true"><line x1="0" x2="30" y1="5" y2="5" stroke="{{ layer.color }}"
 stroke-width="2.5" stroke-dasharray="{{ layer.dash }}"/></svg>{{ layer.name }}</label>
{% endfor %}
</fieldset>
<div class="controls" role="group" aria-label="Part of the time that is shown">
<button type="button" data-move="earlier">← earlier</button>
<button type="button" data-move="later">later →</button>
<button type="button" data-move="excerpt">{{ picture.end - picture.begin }} steps</button>
<button type="button" data-move="all">all {{ "{:,}".format(picture.n_steps) }} steps</button>
</div>
<div id="picture" role="img" aria-label="State over time, measured and as each method restores it, with bands
of
 90 %; below it the mean of the switch. The table above holds the errors."></div>
<p class="soft">Lines are estimates from the observations up to each step, bands are central intervals of 90
% as each
method claims them. The switch says which regime the filter believes in: 0 and 1 are the two regimes, and
what lies
between is a mixture of them.{% if picture.n_steps < picture.n_all %} The picture shows
{{ "{:,}".format(picture.n_steps) }} steps from the middle of the {{ "{:,}".format(picture.n_all) }} that were
compared.{% endif %}</p>
"""

_WORDS = """
<dl class="words">
<dt>RMSE</dt><dd>Root mean squared error of the restored state, in its unit. The interval of 95 % says how
much the
figure would vary over other stretches of this kind; it knows nothing of a season that the learning part has
not seen.</dd>
<dt>90 % covers</dt><dd>How often the true state lay in the method's own interval of 90 %. Far below 90, a
method claims
more than it knows; far above, less.</dd>
<dt>log-lik. per step</dt><dd>Mean log-density of each observation given the earlier ones. A difference of
0.1 means that
each observation is 10 % likelier. A method can describe the observation better and restore the state
worse.</dd>
<dt>µs per step</dt><dd>Time of one step of the online filter, on the machine of this report.</dd>
</dl>
"""

#: The whole page.
PAGE = (
    """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:">
<title>{{ title }}: {{ state_label }}</title>
<link rel="icon" href="data:,">
<style>"""
    + _STYLE
    + """</style>
</head>
<body>
{% set space = " " if unit else "" %}
{% set rmse = "RMSE (" ~ unit ~ ")" if unit else "RMSE" %}
{% set labels = [rmse, "95 % interval", "90 % covers", "log-lik. per step", "µs per step"] %}
<header><div>
<p>fuzzykf compare: filters with fuzzy and hard switches, IMM, Kalman filter and regressions, side by side</p>
<h1>{{ title }}: {{ state_label }}</h1>
</div></header>
<main>
<section class="verdict" aria-labelledby="verdict">
<h2 id="verdict">What comes out</h2>
<p>{{ verdict }}</p>
{% if not is_certain %}
<p>On another stretch of the same data the order of the best two could be the other way round.</p>
{% endif %}
<p class="soft">{{ about_task }}</p>
</section>
<section aria-labelledby="methods">
<h2 id="methods">The methods</h2>
"""
    + _TABLE
    + """
<p class="soft">{{ about_intervals }}</p>
{% for sentence in choices %}
<p>{{ sentence }}</p>
{% endfor %}
</section>
<section aria-labelledby="states">
<h2 id="states">State and switch</h2>
"""
    + _PICTURE
    + """
</section>
<section aria-labelledby="words">
<h2 id="words">How to read the figures</h2>
"""
    + _WORDS
    + """
</section>
{% if settings %}
<section aria-labelledby="settings">
<h2 id="settings">Settings</h2>
<dl>
{% for key, value in settings.items() %}
<dt>{{ key }}</dt><dd>{{ value }}</dd>
{% endfor %}
</dl>
</section>
{% endif %}
</main>
<footer><p>Made by fuzzykf. This page holds all it needs and loads nothing from anywhere.</p></footer>
<script>{{ plotly | safe }}</script>
<script type="application/json" id="abscissa">{{ picture.x | as_json }}</script>
<script type="application/json" id="figure">{{ picture.figure | as_json }}</script>
<script type="application/json" id="view">{{ {"begin": picture.begin, "end": picture.end} | tojson }}</script>
<script>"""
    + _SCRIPT
    + """</script>
</body>
</html>
"""
)

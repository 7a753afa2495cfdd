// The style sheet, light and dark.

export const STYLE = `
:host { all: initial; display: block; position: relative; width: 100%; height: 100%; min-height: 240px }
.view { --ground: #f6f7f9; --card: rgba(255, 255, 255, .93); --edge: #dde1e7; --ink: #20262e; --faint: #66707c; --mark: #1f6fc4;
  --hover: #eceff3; --alarm: #b3261e;
  position: absolute; inset: 0; overflow: hidden; background: var(--ground); color: var(--ink); outline: none;
  font: 13px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; user-select: none;
  -webkit-user-select: none; container-type: size }
.view[data-theme=dark] { --ground: #0d1117; --card: rgba(21, 27, 35, .93); --edge: #2b333e; --ink: #e6eaf0; --faint: #93a0b0;
  --mark: #5aa9f5; --hover: #232b36; --alarm: #ff8a80 }
.view * { box-sizing: border-box }
.view > canvas { position: absolute; inset: 0; width: 100%; height: 100%; touch-action: none; cursor: grab; display: block }
.view > canvas:active { cursor: grabbing }
.names { position: absolute; inset: 0; pointer-events: none; overflow: hidden }
.name { will-change: transform; position: absolute; left: 0; top: 0; padding: 0 3px; border: 0; background: none; color: var(--ink); opacity: .85;
  font: 12px/16px inherit; font-family: inherit; font-size: 12px; white-space: nowrap; pointer-events: auto; cursor: pointer }
.name:hover, .name.followed { opacity: 1; text-decoration: underline; text-underline-offset: 3px }
.head { position: absolute; left: 16px; top: 12px; max-width: calc(100% - 360px); pointer-events: none }
.title { font-size: 17px; font-weight: 650; letter-spacing: -.01em; white-space: nowrap; overflow: hidden;
  text-overflow: ellipsis }
.caption, .status, .note { color: var(--faint); font-size: 12px }
.status { color: var(--mark); font-variant-numeric: tabular-nums }
.status:empty { display: none }
.side { position: absolute; right: 12px; top: 56px; bottom: 76px; width: 288px; display: flex; flex-direction: column; gap: 8px;
  overflow-y: auto; scrollbar-width: thin; pointer-events: none }
.side > * { pointer-events: auto }
.card { background: var(--card); border: 1px solid var(--edge); border-radius: 10px; padding: 9px 11px; flex: none }
.hidden { display: none !important }
.tools { position: absolute; right: 12px; top: 12px; display: flex; gap: 6px }
button.tool, select { height: 32px; min-width: 32px; border: 1px solid var(--edge); border-radius: 8px; background: var(--card);
  color: var(--ink); font: inherit; padding: 0 7px; cursor: pointer; display: inline-flex; align-items: center;
  justify-content: center }
button.tool:hover, select:hover { background: var(--hover) }
button.tool:focus-visible, select:focus-visible, input:focus-visible, .name:focus-visible { outline: 2px solid var(--mark);
  outline-offset: 1px }
button.tool[aria-pressed=true] { color: var(--mark); border-color: var(--mark) }
button.tool svg { width: 16px; height: 16px; fill: none; stroke: currentColor; stroke-width: 1.7; stroke-linecap: round;
  stroke-linejoin: round }
button.tool svg .solid { fill: currentColor }
.legend { position: absolute; left: 12px; bottom: 76px; width: 196px }
.legend label { display: flex; align-items: center; gap: 8px; color: var(--faint); font-size: 12px }
.legend select { height: 26px; flex: 1; background: none }
.classes { display: flex; flex-wrap: wrap; gap: 3px 12px; margin-top: 7px }
.class { display: inline-flex; align-items: center; gap: 6px; max-width: 100%; overflow: hidden; text-overflow: ellipsis;
  white-space: nowrap }
.class i { width: 10px; height: 10px; border-radius: 50%; flex: none }
.bar { height: 9px; border-radius: 5px; margin-top: 9px }
.ends { display: flex; justify-content: space-between; color: var(--faint); font-size: 11.5px; margin-top: 3px;
  font-variant-numeric: tabular-nums }
.size { margin-top: 7px }
.size input { flex: 1; width: 60px; accent-color: var(--mark) }
.view > canvas.compass { inset: auto; left: 214px; bottom: 74px; width: 64px; height: 64px; pointer-events: none }
.foot { will-change: transform; position: absolute; left: 12px; right: 12px; bottom: 12px; display: flex; align-items: center; gap: 8px; height: 52px;
  padding: 0 10px }
.foot.single { left: auto }
.foot .track { position: relative; flex: 1; min-width: 60px; height: 32px; display: flex; align-items: center }
.foot input { width: 100%; margin: 0; accent-color: var(--mark); cursor: pointer }
.ticks { position: absolute; left: 8px; right: 8px; top: 1px; height: 5px; pointer-events: none }
.ticks i { position: absolute; width: 2px; height: 6px; margin-left: -1px; background: var(--alarm); border-radius: 1px }
.clock { margin-left: auto; text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; min-width: 150px }
.clock b { font-weight: 600 }
.clock span { display: block; color: var(--faint); font-size: 11.5px }
.curvehead { display: flex; gap: 6px; align-items: baseline; font-weight: 600; font-size: 12px }
.curvehead .unit { color: var(--faint); font-weight: 400; flex: 1; font-size: 11.5px }
.curvehead .now { font-variant-numeric: tabular-nums; color: var(--mark) }
.plot { position: relative; height: 84px; cursor: crosshair; touch-action: none; margin-top: 3px }
.plot canvas { position: absolute; inset: 0; width: 100%; height: 84px }
.marker { will-change: transform; position: absolute; left: -.5px; top: 0; bottom: 0; width: 1px; background: var(--ink); opacity: .7 }
.most, .least { position: absolute; right: 2px; font-size: 10.5px; color: var(--faint); font-variant-numeric: tabular-nums;
  background: var(--card); border-radius: 3px; padding: 0 2px; line-height: 13px; pointer-events: none }
.most { top: 0 } .least { bottom: 0 }
details summary { cursor: pointer; font-weight: 600; font-size: 12px; list-style-position: inside }
dl { margin: 6px 0 0; font-size: 12px }
dt { color: var(--faint); font-size: 11.5px }
dd { margin: 0 0 5px; user-select: text; -webkit-user-select: text; overflow-wrap: anywhere }
.event { display: block; width: 100%; text-align: left; border: 0; background: none; color: inherit; font: inherit;
  font-size: 12px; padding: 2px 0; cursor: pointer }
.event:hover { color: var(--mark) }
.notes .note + .note { margin-top: 3px }
.help { position: absolute; inset: 0; margin: auto; width: 330px; max-width: calc(100% - 24px); height: fit-content;
  max-height: calc(100% - 24px); overflow: auto; padding: 16px 18px; box-shadow: 0 12px 40px rgba(0, 0, 0, .25) }
.help h2 { margin: 0 0 8px; font-size: 14px }
.help div { display: flex; gap: 10px; padding: 2px 0 }
.help kbd { font: 12px ui-monospace, Menlo, Consolas, monospace; min-width: 96px; color: var(--mark) }
@container (max-width: 720px) {
  .side { left: 12px; width: auto; top: 96px; background: var(--ground); z-index: 1 }
  .head { max-width: calc(100% - 32px); top: 52px }
  .clock { min-width: 84px } .clock span, .foot .wide { display: none }
  .legend { max-width: 180px } .view > canvas.compass { display: none }
}
@container (max-height: 420px) { .legend .size, .view > canvas.compass { display: none } }
@media (prefers-reduced-motion: no-preference) { button.tool { transition: background .12s } }
`;

// Icons in a square of 16, as attributes of SVG paths.
export const ICONS = {
  play: [["M4.5 2.8v10.4L13 8z", "solid"]],
  pause: [["M5 3v10M11 3v10"]],
  back: [["M10.5 3.5 6 8l4.5 4.5"]],
  on: [["M5.5 3.5 10 8l-4.5 4.5"]],
  reset: [["M3 8a5 5 0 1 0 1.6-3.7M3 2.6v2.6h2.6"]],
  turn: [["M2 8c0-1.9 2.7-3.2 6-3.2S14 6.100 14 8s-2.700 3.200-6 3.200M10 9l-2 2.200 2 2.200"]],
  camera: [["M2 5.200h2.600L6 3.400h4l1.400 1.800H14v7.400H2z"], ["M8 11a2.200 2.200 0 1 0 0-4.400A2.200 2.200 0 0 0 8 11z"]],
  theme: [["M8 2.500a5.500 5.500 0 1 0 0 11z", "solid"], ["M8 13.500a5.500 5.500 0 1 0 0-11 5.500 5.500 0 0 0 0 11z"]],
  panel: [["M2.500 13V3M2.500 13h11M4.500 10.500l3-4 2.500 2 3.500-4.500"]],
  box: [["M8 2l5 2.800v6.400L8 14l-5-2.800V4.800zM3 4.800l5 2.800 5-2.800M8 7.600V14"]],
  orbits: [["M8 9.300a1.300 1.300 0 1 0 0-2.600 1.300 1.300 0 0 0 0 2.600z", "solid"],
    ["M14 8c0 2-2.700 3.600-6 3.600S2 10 2 8s2.700-3.600 6-3.600S14 6 14 8z"]],
  help: [["M6 6.200a2 2 0 1 1 2.900 1.800c-.6.300-.9.700-.9 1.500M8 12v.1"]],
};

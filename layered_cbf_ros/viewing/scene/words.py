"""What is written beside the scene: the state of the run, and a table of its nodes."""

from __future__ import annotations

from html import escape

import numpy as np

from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.viewing.palette import ROBOTS, STOPPED
from layered_cbf_ros.viewing.scene.colours import css, safety_colours
from layered_cbf_ros.viewing.sight.snapshot import NodeSight, Snapshot

FAULTS = ('solver_failures', 'slack_events', 'rejected')
LEVEL_COLOURS = {'OK': '#2e9e5b', 'WARN': '#d98e04', 'ERROR': '#b2182b', 'STALE': '#8a94a3'}
NUMBER = 'font-variant-numeric:tabular-nums'
TEXT = 'font:13px/1.5 system-ui,sans-serif;color:#2a303a'


def waiting_words(missing: str) -> str:
    """Return what is shown before there is anything to see."""
    return f'<div style="{TEXT};padding:2px 12px">waiting for {escape(missing)} ...</div>'


def status_words(snapshot: Snapshot) -> str:
    """Return the state of a run in two lines: the time, the smallest h, and what is special."""
    badges = ''
    if snapshot.is_stopped:
        badges += _badge('EMERGENCY STOP', css(STOPPED))
    if snapshot.is_paused:
        badges += _badge('paused', '#5b6470')
    steered = [robot.name for robot in snapshot.robots if robot.is_steered]
    if steered:
        badges += _badge(f'steered: {", ".join(steered)}', css(ROBOTS[0]))
    return (
        f'<div style="{TEXT};padding:2px 12px"><b style="{NUMBER}">'
        f'{snapshot.stamp_ns / NS_PER_S:.2f} s</b><br>{_closest(snapshot)}{badges}</div>'
    )


def node_table(nodes: tuple[NodeSight, ...]) -> str:
    """Return a table of the nodes: rate, misses, faults and what each has to say."""
    if not nodes:
        return f'<div style="{TEXT};padding:4px 12px">no node has told anything yet</div>'
    head = ''.join(f'<th style="text-align:{a}">{t}</th>' for a, t in (
        ('left', 'node'), ('right', 'Hz'), ('right', 'missed'), ('right', 'faults'),
    ))  # fmt: skip
    rows = ''.join(_node_row(node) for node in nodes)
    return (
        f'<table style="{TEXT};font-size:12px;width:100%;border-spacing:6px 2px">'
        f'<tr style="color:#8a94a3">{head}</tr>{rows}</table>'
    )


def _node_row(node: NodeSight) -> str:
    values = node.values
    faults = sum(int(values[key]) for key in FAULTS if values.get(key, '').isdigit())
    colour = LEVEL_COLOURS.get(node.level, LEVEL_COLOURS['STALE'])
    dot = f'<span title="{node.level}" style="color:{colour}">&#9679;</span>'
    cells = (values.get('rate_hz', '-'), values.get('deadline_misses', '-'), str(faults))
    row = ''.join(f'<td style="text-align:right;{NUMBER}">{escape(cell)}</td>' for cell in cells)
    said = node.message if node.message not in ('running', '') else values.get('waiting_for', '')
    if node.level == 'STALE':
        said = f'silent; before: {node.message}'
    note = (
        f'<tr><td colspan="4" style="color:{colour};font-size:11px">{escape(said)}</td></tr>'
        if said
        else ''
    )
    return f'<tr><td>{dot} {escape(node.name.lstrip("/"))}</td>{row}</tr>{note}'


def _closest(snapshot: Snapshot) -> str:
    """Return which pair has the smallest h, in its colour."""
    if not snapshot.barriers:
        return 'no pair has a barrier<br>'
    pair = min(snapshot.barriers, key=lambda each: each.psi0)
    r, g, b = safety_colours(np.array([pair.psi0]))[0].tolist()
    return (
        f'<span style="color:{css((r, g, b))}">&#9679;</span> smallest h '
        f'<b style="{NUMBER}">{pair.psi0:.2f} m</b>, '
        f'{escape(pair.label.replace("~", " and "))}<br>'
    )


def _badge(text: str, colour: str) -> str:
    return (
        f'<span style="background:{colour};color:white;border-radius:4px;padding:1px 7px;'
        f'margin-right:6px;font-size:12px">{escape(text)}</span>'
    )

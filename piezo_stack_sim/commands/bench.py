# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack bench``: speed and accuracy beside peers, in one run."""

import json

import click

from piezo_stack_sim.commands.options import single
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.terminal import console


@click.command('bench')
@click.option('--params', metavar='YAML', multiple=True, callback=single,
              help="Parameter file; the paper's if not given.")
@click.option('--quick', is_flag=True, help='Shorter slices: a look within seconds.')
@click.option('--effects', is_flag=True, help='Measure nothing but what each effect costs.')
@click.option('--node', is_flag=True, help='Measure the ROS node too (needs rclpy).')
@click.option('--only-node', is_flag=True, help='Measure nothing but the ROS node.')
@click.option('--json', 'as_json', is_flag=True, help='Print JSON in SI units.')
def command(params, quick, effects, node, only_node, as_json):
    """
    Measure the plant, scipy, ngspice and a plain loop on the same commands.

    Speed is device time over processor time of one core; the accuracy beside it is the largest
    distance to a reference that is computed in the same run.

    """
    from piezo_stack_sim.plant import load_device

    if quick and (effects or only_node):
        raise InputError(f'--quick: --{"effects" if effects else "only-node"} has no shorter way; '
                         'leave it out')
    result = {}
    device = load_device(params) if params else None
    if effects:
        from piezo_stack_sim.bench.effects import measure as measure_effects

        result['effects'] = measure_effects(device)
    elif not only_node:
        from piezo_stack_sim.bench.speed import measure

        result['speed'] = measure(device, quick)
    if node or only_node:
        result['node'] = _measure_node()
    if as_json:
        click.echo(json.dumps(result, indent=2))
        return
    if 'speed' in result:
        _print_speed(result['speed'])
    if 'effects' in result:
        _print_effects(result['effects'])
    if 'node' in result:
        _print_node(result['node'])


def _print_effects(cost):
    from rich.table import Table

    screen = console(120)
    rows = Table(title=f'Five test programmes, {cost["rows"]:,} rows, processor time',
                 title_justify='left')
    for column in ('effect', 'time', 'x without'):
        rows.add_column(column, justify='left' if column == 'effect' else 'right')
    rows.add_row('none', f'{1e3 * cost["absent"]:.1f} ms', '1.00')
    for name, row in (('all, neutral', cost['neutral']), *cost['effects'].items(),
                      ('all, typical', cost['all'])):
        rows.add_row(name.replace('_', ' '), f'{1e3 * row["time"]:.1f} ms', f'{row["ratio"]:.2f}',
                     end_section=name == 'all, neutral' or name == list(cost['effects'])[-1])
    screen.print(rows)


def _print_speed(speed):
    from rich.table import Table

    screen = console(120)
    plant, machine = speed['plant'], speed['machine']
    screen.print(f'{machine["processor"]}, one of {machine["cores"]} cores, '
                 f'Python {machine["python"]}')

    rows = Table(title='Plant, test programmes whole, after warm-up', title_justify='left')
    for column in ('programme', 'rows', 'device time', 'processor time', 'x real time',
                   'off in x', 'off in q'):
        rows.add_column(column, justify='left' if column == 'programme' else 'right')
    total = {'rows': sum(row['rows'] for row in plant['programmes'].values()),
             'duration': plant['simulated'], **plant}
    for name, row in (*plant['programmes'].items(), ('all', total)):
        rows.add_row(name, f'{row["rows"]}', f'{row["duration"]:.1f} s',
                     f'{1e3 * row["time"]:.2f} ms', f'{row["real_time_factor"]:,.0f}',
                     *_off(row), end_section=name == 'force')
    screen.print(rows)

    rows = Table(title='Side by side', title_justify='left')
    for column in ('', 'x real time', 'plant is faster by', 'off in x', 'off in q', 'computed'):
        rows.add_column(column, justify='left' if column in ('', 'computed') else 'right')
    for row in (plant, *speed['peers']):
        faster = row.get('plant_is_faster_by')
        rows.add_row(
            row['name'], f'{row["real_time_factor"]:,.3g}' if faster
            else f'{row["real_time_factor"]:,.0f}', f'{faster:,.0f}' if faster else '', *_off(row),
            f'{row["simulated"]:.2g} s, extrapolated' if row['extrapolated']
            else f'{row["simulated"]:.1f} s')
    screen.print(rows)
    reference = speed['reference']
    screen.print(
        f'off: largest distance to a {reference["method"]} of {1e9 * reference["step"]:.0f} ns '
        f'steps, which is itself within {1e9 * reference["displacement_error"]:.2g} nm and '
        f'{1e9 * reference["charge_error"]:.2g} nC of one of twice the step.')
    for name in speed['missing']:
        screen.print(f'{name} is not installed and therefore left out.')


def _off(row):
    return (f'{1e9 * row["displacement_error"]:.2g} nm', f'{1e9 * row["charge_error"]:.2g} nC')


def _measure_node():
    """Measure the node beside a bare one, in processes of their own, at several rates."""
    from dataclasses import asdict

    from piezo_stack_sim.node import bench
    from piezo_stack_sim.plant.compilation import compile_kernels
    from piezo_stack_sim.progress import track

    compile_kernels()  # or the first nodes would do so beside their ticks
    timings = [measure() for measure in track(bench.rate_table(), 'Timing the node')]
    device, bare = (next(each for each in timings if (each.name, each.rate) == (name, 1000.0))
                    for name in (bench.DEVICE, bench.BARE))
    return {'timings': [asdict(timing) for timing in timings],
            'processor_ratio_at_1_khz': bench.cpu_ratio(device, bare),
            'lockstep': asdict(bench.lockstep_speed()), 'start': bench.start_times()}


def _print_node(node):
    from rich.table import Table

    screen = console(130)
    rows = Table(title='Node, ticks by wall time', title_justify='left')
    for column in ('', 'rate', 'of a core', 'ticks', 'missed', 'late: median', '99 %', '99.9 %',
                   'most', 'within 0.5 ms'):
        rows.add_column(column, justify='left' if not column else 'right', no_wrap=True)
    previous = None
    for row in node['timings']:
        if previous not in (None, row['rate']):
            rows.add_section()
        previous = row['rate']
        late = [f'{1e6 * row[f"late_{name}"]:.0f} µs' for name in ('p50', 'p99', 'p999', 'max')]
        rows.add_row(row['name'], f'{row["rate"]:.0f} Hz', f'{100.0 * row["cpu"]:.1f} %',
                     f'{row["ticks"]}', f'{row["missed"]}', *late,
                     f'{100.0 * row["within_half_ms"]:.2f} %')
    screen.print(rows)
    lockstep = node['lockstep']
    screen.print(
        f'At 1 kHz the node takes {node["processor_ratio_at_1_khz"]:.2f} times the processor time '
        'of a bare rclpy node that publishes the same messages.\n'
        f'Lockstep with a client in another process: {lockstep["exchanges_per_second"]:,.0f} '
        f'exchanges a second (round trip {1e6 * lockstep["round_trip_p50"]:.0f} µs, 99 % '
        f'{1e6 * lockstep["round_trip_p99"]:.0f} µs), '
        f'{lockstep["burst_per_second"]:,.0f} ticks a second in a burst.\n'
        f'Ready after {node["start"]["cold"]:.1f} s where it has never run, then after '
        f'{node["start"]["warm"]:.1f} s.')

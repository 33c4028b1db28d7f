# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command ``piezo_stack``: finds a subcommand, runs it, words whatever goes wrong."""

from difflib import get_close_matches
from importlib import import_module
import os
from pathlib import Path
import sys

import click

from piezo_stack_sim.atomic import guard_inputs
from piezo_stack_sim.errors import InputError

# In the order of the help. Each is a module of piezo_stack_sim.commands that defines `command`;
# the summaries stand here so that the help imports none of them.
COMMANDS = {
    'simulate': 'Replay the commands and forces of a recording set through the plant.',
    'compare': 'Show the gap between recordings and simulation and where it lies.',
    'diagnose': 'Find out which missing effects cause the gap; write report and mend.',
    'report': 'Render report.html again from a diagnosis.json.',
    'identify': 'Find the parameters of an actuator from recordings.',
    'from-datasheet': 'Estimate the parameters of an actuator from its data sheet.',
    'excite': 'Play a test programme to the device behind the topics and record it.',
    'effects': 'List the effects that a device can have.',
    'analyse': "Print a device's stiffness, resonance, stroke and other derived figures.",
    'figures': "Draw the paper's figures.",
    'export': 'Write the device as a circuit for a SPICE simulator.',
    'challenge': 'Make, answer and score a blind benchmark.',
    'bench': 'Measure speed and accuracy against peers.',
    'soak': 'Leave two nodes running, do to them what may happen, and see what holds.',
}
FOLDER = Path(__file__).resolve().parent / 'commands'


def _module(name):
    return name.replace('-', '_')


class LazyGroup(click.Group):
    """A group whose subcommands are imported when they are called, not before."""

    def list_commands(self, ctx):
        """Return the subcommands that are installed."""
        return [name for name in COMMANDS if (FOLDER / f'{_module(name)}.py').is_file()]

    def get_command(self, ctx, cmd_name):
        """Import a subcommand."""
        if cmd_name not in self.list_commands(ctx):
            return None
        return import_module(f'piezo_stack_sim.commands.{_module(cmd_name)}').command

    def resolve_command(self, ctx, args):
        """Find the subcommand, or name the nearest one."""
        names = self.list_commands(ctx)
        if args and args[0] not in names and not args[0].startswith('-'):
            close = get_close_matches(args[0], names, n=1)
            hint = f'did you mean {close[0]}?' if close else f'choose {", ".join(names)}'
            ctx.fail(f'no command {args[0]!r}; {hint}')
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx, formatter):
        """Write the summaries without importing anything."""
        with formatter.section('Commands'):
            formatter.write_dl([(name, COMMANDS[name]) for name in self.list_commands(ctx)])


def _print_version(ctx, _parameter, wanted):
    if wanted:
        from importlib.metadata import PackageNotFoundError, version
        try:
            click.echo(f'piezo_stack {version("piezo_stack_sim")}')
        except PackageNotFoundError:
            click.echo('piezo_stack (not installed)')
        ctx.exit()


def _print_config(ctx, _parameter, wanted):
    if wanted:
        from piezo_stack_sim.resources import config_folder
        click.echo(config_folder())
        ctx.exit()


@click.group(cls=LazyGroup, context_settings={'help_option_names': ['-h', '--help']})
@click.option('--version', is_flag=True, is_eager=True, expose_value=False,
              callback=_print_version, help='Print the version.')
@click.option('--config', is_flag=True, is_eager=True, expose_value=False,
              callback=_print_config, help='Print the folder of the parameter files supplied.')
def cli():
    """
    Simulate a piezoelectric stack actuator and explain what a real one does differently.

    "piezo_stack COMMAND --help" tells more. Exit status: 0 done, 2 wrong input or arguments.

    """


def main(argv=None):
    """
    Run ``piezo_stack`` and return its exit status.

    Parameters
    ----------
    argv : list of str, optional
        The arguments; by default those of the process.

    Returns
    -------
    int
        0 done, 1 a fault of the program or its installation, 2 wrong input or arguments,
        130 interrupted, 141 nobody reads the output any more.

    """
    # Small products of matrices from many threads: a BLAS with threads of its own only spins.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    argv = list(sys.argv[1:] if argv is None else argv) or ['--help']
    guard_inputs()
    try:
        try:
            with cli.make_context('piezo_stack', argv) as context:
                cli.invoke(context)
            status = 0
        except click.exceptions.Exit as done:
            status = done.exit_code
        sys.stdout.flush()
        return status
    except InputError as error:
        return _fail(error, 2)
    except click.UsageError as error:
        where = error.ctx.command_path if error.ctx else 'piezo_stack'
        message = error.format_message().rstrip('.')
        # The whole help is that of a group that was given nothing.
        if error.ctx and isinstance(error.ctx.command, click.Group) and (
                message.startswith('Usage:')):
            names = ', '.join(error.ctx.command.list_commands(error.ctx))
            message = f'expected a command after it; choose {names}'
        return _fail(f'{where}: {message}; see "{where} --help"', 2)
    except click.ClickException as error:
        return _fail(error.format_message(), 2)
    except (KeyboardInterrupt, click.Abort):
        return _fail('interrupted', 130)
    except BrokenPipeError:
        # The interpreter flushes stdout once more at its end; give it somewhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except OSError as error:
        if os.environ.get('PIEZO_STACK_DEBUG') == '1':
            raise
        if error.strerror is None:
            return _fail(_fault(error), 1)
        if error.filename is None:  # what is written to no file goes to the terminal
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _fail(f'{error.filename or "the output"}: {error.strerror}: expected something '
                     'that can be read and written; give another path or its permissions', 2)
    except Exception as error:
        if os.environ.get('PIEZO_STACK_DEBUG') == '1':
            raise
        return _fail(_fault(error), 1)


def _fault(error):
    """Word an error that the user's input is not to blame for."""
    if isinstance(error, ModuleNotFoundError) and not str(error.name).startswith(__package__):
        module = str(error.name).partition('.')[0]
        extras = {'dask': 'dask', 'distributed': 'dask', 'diagnostic_msgs': 'ros',
                  'rclpy': 'ros', 'rcl_interfaces': 'ros', 'rosgraph_msgs': 'ros',
                  'sensor_msgs': 'ros', 'std_msgs': 'ros', 'std_srvs': 'ros'}
        package = f'piezo_stack_sim[{extras[module]}]' if module in extras else module
        return (f'piezo_stack: the Python module {module} is not installed; install it, for '
                f'instance with pip install "{package}"')
    text = ' '.join(str(error).split())[:300]
    return (f'piezo_stack: internal error: {type(error).__name__}: {text}; '
            'PIEZO_STACK_DEBUG=1 shows where')


def _fail(message, status):
    text = ' '.join(str(message).split())
    click.echo(text, err=True)
    return status


if __name__ == '__main__':
    sys.exit(main())

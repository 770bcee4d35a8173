"""`spherekit completion`: code by which a shell completes the words of spherekit."""

from argparse import ArgumentParser, Namespace

EXAMPLES = """examples:
  # for this session of bash; write it into ~/.bashrc for all sessions
  eval "$(spherekit completion bash)"
  # in ~/.zshrc, after compinit
  eval "$(spherekit completion zsh)"
  # in ~/.config/fish/config.fish
  spherekit completion fish | source
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit completion`."""
    parser.add_argument(
        "shell",
        choices=("bash", "zsh", "fish"),
        help="the shell for which the completion script is printed",
    )


def execute(options: Namespace) -> int:
    """Print the shell's code."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(["spherekit"], shell=options.shell))
    return 0

"""`python -m caesura_service`: the service's own commands, without the clients'."""

import typer

from caesura_service.commands import register

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def main() -> None:
    """Caesura divides a demonstration, while it is taught, into segments with a meaning."""


register(app)

if __name__ == "__main__":
    app()

defmodule BB.Bus.GPIO do
  @moduledoc """
  Chooses the module that drivers call for GPIO.

  Drivers take their module from here and call it. `BB.Bus.GPIO.Line` does so for most of them.

      gpio = BB.Bus.GPIO.module(opts[:gpio])
      {:ok, line} = gpio.open({"gpiochip0", 17}, :input, pull_mode: :pullup, on_busy: :take_over)
      :ok = gpio.set_interrupts(line, :both)
      receive do
        {:circuits_gpio, {"gpiochip0", 17}, timestamp_ns, level} -> {timestamp_ns, level}
      end

  The module is `Circuits.GPIO` where that library is loaded, as on a board, otherwise the
  simulation, `BB.Bus.Sim.GPIO`. `config :ganglion, gpio: …` names another one, such as
  `BB.Bus.Linux.GPIO`. All of them have the functions, results, messages and error atoms of
  `Circuits.GPIO`, which are the interface.

  One process has a line at a time, and the handle of a process that died can live for a moment.
  So open with `on_busy: :take_over`. Keep the handle, because its messages end with it.
  Timestamps are those of the kernel. Compare them only with one another.
  """

  @doc """
  Returns the module `given`, otherwise the one of `config :ganglion, :gpio`, otherwise
  `Circuits.GPIO` where it can be loaded, otherwise `BB.Bus.Sim.GPIO`.
  """
  @spec module(module() | nil) :: module()
  def module(nil), do: Application.get_env(:ganglion, :gpio) || default()
  def module(given) when is_atom(given), do: given

  defp default,
    do: if(Code.ensure_loaded?(Circuits.GPIO), do: Circuits.GPIO, else: BB.Bus.Sim.GPIO)
end

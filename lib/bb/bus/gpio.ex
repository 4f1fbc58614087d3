defmodule BB.Bus.GPIO do
  @moduledoc """
  Which module stands for GPIO here.

  It is `Circuits.GPIO` where that library is there, as on a board, else the simulation,
  `BB.Bus.Sim.GPIO`, which has the same functions, results, messages and error atoms;
  `config :ganglion, gpio: …` names another. That set of functions is the interface: a driver takes the module from here and calls it.

      gpio = BB.Bus.GPIO.module(opts[:gpio])
      {:ok, line} = gpio.open({"gpiochip0", 17}, :input, pull_mode: :pullup, on_busy: :take_over)
      :ok = gpio.set_interrupts(line, :both)
      receive do: ({:circuits_gpio, {"gpiochip0", 17}, timestamp_ns, level} -> {timestamp_ns, level})

  A line is one process's at a time, and a handle whose process has died may live for a moment: open with `on_busy: :take_over`,
  and keep the handle, since its messages end with it. Timestamps are the kernel's and comparable only with one another.
  """

  @doc """
  The module that was `given`, or else that of `config :ganglion, :gpio`; without it `Circuits.GPIO`
  where it can be loaded, or else `BB.Bus.Sim.GPIO`.
  """
  @spec module(module() | nil) :: module()
  def module(nil), do: Application.get_env(:ganglion, :gpio) || default()
  def module(given) when is_atom(given), do: given

  defp default,
    do: if(Code.ensure_loaded?(Circuits.GPIO), do: Circuits.GPIO, else: BB.Bus.Sim.GPIO)
end

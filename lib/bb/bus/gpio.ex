defmodule BB.Bus.GPIO do
  @moduledoc """
  Which module stands for GPIO here.

  On a board it is `Circuits.GPIO`, on the host `BB.Bus.Sim.GPIO`, which has the same functions, results, messages and error
  atoms. That set of functions is the interface: a driver takes the module from here and calls it.

      gpio = BB.Bus.GPIO.module(opts[:gpio])
      {:ok, line} = gpio.open({"gpiochip0", 17}, :input, pull_mode: :pullup, on_busy: :take_over)
      :ok = gpio.set_interrupts(line, :both)
      receive do: ({:circuits_gpio, {"gpiochip0", 17}, timestamp_ns, level} -> {timestamp_ns, level})

  A line is one process's at a time, and a handle whose process has died may live for a moment: open with `on_busy: :take_over`,
  and keep the handle, since its messages end with it. Timestamps are the kernel's and comparable only with one another.
  """

  @doc "The module that was `given`, or else that of `config :ganglion, :gpio`, or else `Circuits.GPIO`."
  @spec module(module() | nil) :: module()
  def module(nil), do: Application.get_env(:ganglion, :gpio, Circuits.GPIO)
  def module(given) when is_atom(given), do: given
end

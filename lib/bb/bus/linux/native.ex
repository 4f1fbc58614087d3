defmodule BB.Bus.Linux.Native do
  @moduledoc false

  # Elixir loads a module after its compilation. A NIF that was built for a board must not be
  # loaded on the machine that builds it.
  @compile {:autoload, false}

  use BB.NativeLibrary, "linux_bus_nif"

  def i2c_open(_path, _timeout_steps), do: not_loaded()
  def i2c_read(_bus, _address, _data, _count), do: not_loaded()
  def i2c_write(_bus, _address, _data), do: not_loaded()
  def i2c_close(_bus), do: not_loaded()

  def gpio_chip(_path), do: not_loaded()
  def gpio_status(_path, _offset), do: not_loaded()
  def gpio_open(_path, _offsets, _direction, _levels, _modes), do: not_loaded()
  def gpio_close(_lines), do: not_loaded()
  def gpio_force_close(_path, _offset), do: not_loaded()
  def gpio_read(_lines), do: not_loaded()
  def gpio_write(_lines, _levels), do: not_loaded()
  def gpio_set_direction(_lines, _direction), do: not_loaded()
  def gpio_set_pull(_lines, _pull), do: not_loaded()
  def gpio_set_drive(_lines, _drive), do: not_loaded()
  def gpio_listen(_lines, _form, _trigger, _receiver, _label), do: not_loaded()

  defp not_loaded, do: :erlang.nif_error(:not_loaded)
end

defmodule BB.Sensor.Conformance.GPIO do
  @moduledoc """
  The wires of a device on GPIO lines: a simulated GPIO chip of its own for each test.

  `BB.Sensor.Conformance` uses it when the model of the device defines `pins/0`.
  """
  @moduledoc no_example: "internal: BB.Sensor.Conformance chooses the wires by the device's model"

  @behaviour BB.Sensor.Conformance.Wires

  alias BB.Bus.Sim.Lines

  @device :device
  @storm_hz 1_777

  @impl true
  def faults, do: [:unplug, :cut, :short, :storm]

  @impl true
  def absence, do: :busy

  @impl true
  def stuck, do: :cut

  @impl true
  def deceptive, do: [:cut, :short, :storm]

  @impl true
  def start(setting, name, clock) do
    {model, opts} = setting.device
    lines = for {_pin, line} <- opts[:pins], do: {name, line}
    devices = %{@device => {model, opts}}
    {:ok, pid} = Lines.start_link(chips: %{name => [devices: devices, clock: clock]})
    {pid, %{chip: name, device: @device, lines: lines}}
  end

  @impl true
  def options(_place), do: []

  @impl true
  def exchange(place, device) do
    :ok = Lines.unplug(place.chip, @device)
    :ok = Lines.plug(place.chip, @device, device)
  end

  @impl true
  def break(place, :unplug), do: Lines.unplug(place.chip, @device)
  def break(place, fault), do: Enum.each(place.lines, &Lines.fault(&1, kind(fault)))

  defp kind(:short), do: {:short, 0}
  defp kind(:storm), do: {:storm, @storm_hz}
  defp kind(fault), do: fault

  @impl true
  def mend(place, :unplug), do: Lines.replug(place.chip, @device)
  def mend(place, _fault), do: Enum.each(place.lines, &Lines.clear/1)

  @impl true
  def free?(place), do: Enum.all?(place.lines, &match?(%{open?: false}, Lines.describe(&1)))
end

defmodule BB.Bus.Sim.Contact do
  @moduledoc """
  A simulated contact, as of a push button, a bumper, a limit switch or an emergency stop.

  Use it to run `BB.Sensor.ContactSwitch` or `BB.Sensor.EmergencyStop` without the contact.

      BB.Bus.Sim.Lines.plug("gpiochip0", :bumper, {BB.Bus.Sim.Contact, pins: [contact: 17]})
      BB.Bus.Sim.Lines.tell("gpiochip0", :bumper, :press)

  A closed contact connects its line to ground or to the supply. An open contact does not drive
  the line.

  ## Options

  - `:normally`: the contact while it is not pressed, `:open` (default) or `:closed`;
  - `:to`: `:ground` (default) or `:supply`;
  - `:bounce_ns`: how long it bounces when it is pressed or released; default 0;
  - `:bounces`: how many times it opens and closes again in that time; default 3.

  Its orders are `:press` and `:release` (`BB.Bus.Sim.Lines.tell/3`).
  """
  @behaviour BB.Bus.Sim.GPIO.Device

  @defaults [normally: :open, to: :ground, bounce_ns: 0, bounces: 3]

  @impl true
  def pins, do: [:contact]

  @impl true
  def init(opts, _now_ns) do
    opts = opts |> Keyword.validate!(@defaults) |> Map.new() |> check!()
    contact = Map.put(opts, :pressed?, false)
    {:ok, contact, [{:drive, :contact, drive(contact)}]}
  end

  @impl true
  def order(:press, now_ns, contact), do: set_pressed(true, now_ns, contact)
  def order(:release, now_ns, contact), do: set_pressed(false, now_ns, contact)
  def order(_order, _now_ns, _contact), do: :error

  defp set_pressed(pressed?, _now_ns, %{pressed?: pressed?} = contact), do: {contact, []}

  defp set_pressed(pressed?, now_ns, contact) do
    drive_before = drive(contact)
    contact = %{contact | pressed?: pressed?}
    drive_after = drive(contact)
    bounces = bounces(contact, now_ns, drive_before, drive_after)
    {contact, [:cancel, {:drive, :contact, drive_after}] ++ bounces}
  end

  defp bounces(%{bounce_ns: 0}, _now_ns, _drive_before, _drive_after), do: []

  defp bounces(contact, now_ns, drive_before, drive_after) do
    steps = 2 * contact.bounces

    for step <- 1..steps//1 do
      drive = if rem(step, 2) == 1, do: drive_before, else: drive_after
      {:drive, :contact, drive, now_ns + div(contact.bounce_ns * step, steps)}
    end
  end

  defp drive(contact) do
    closed? = contact.pressed? == (contact.normally == :open)
    if closed?, do: level(contact.to), else: :z
  end

  defp level(:ground), do: 0
  defp level(:supply), do: 1

  defp check!(%{normally: normally, to: to, bounce_ns: bounce_ns, bounces: bounces} = opts)
       when normally in [:open, :closed] and to in [:ground, :supply] and
              is_integer(bounce_ns) and bounce_ns >= 0 and is_integer(bounces) and bounces > 0,
       do: opts

  defp check!(opts) do
    raise ArgumentError,
          "expected normally: :open or :closed, to: :ground or :supply, bounce_ns: and " <>
            "bounces: numbers, got: #{inspect(opts)}"
  end
end

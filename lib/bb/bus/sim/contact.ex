defmodule BB.Bus.Sim.Contact do
  @moduledoc """
  A simulated contact: of a push button, a bumper, a limit switch or an emergency stop.

      BB.Bus.Sim.Lines.plug("gpiochip0", :bumper, {BB.Bus.Sim.Contact, pins: [contact: 17]})
      BB.Bus.Sim.Lines.tell("gpiochip0", :bumper, :press)

  Closed it connects its line to ground or to the supply, open it leaves the line alone.

  ## Options
  - `:normally`: `:open` (default) or `:closed`: what it is when nobody presses it;
  - `:to`: `:ground` (default) or `:supply`;
  - `:bounce_ns`: how long it bounces when it is pressed or released; default 0;
  - `:bounces`: how many times it opens and closes again in that time; default 3.

  Orders: `:press`, `:release`.
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
  def order(:press, now_ns, contact), do: turn(true, now_ns, contact)
  def order(:release, now_ns, contact), do: turn(false, now_ns, contact)
  def order(_order, _now_ns, _contact), do: :error

  defp turn(pressed?, _now_ns, %{pressed?: pressed?} = contact), do: {contact, []}

  defp turn(pressed?, now_ns, contact) do
    before = drive(contact)
    contact = %{contact | pressed?: pressed?}
    after_it = drive(contact)
    bounces = bounces(contact, now_ns, before, after_it)
    {contact, [:cancel, {:drive, :contact, after_it}] ++ bounces}
  end

  defp bounces(%{bounce_ns: 0}, _now_ns, _before, _after_it), do: []

  defp bounces(contact, now_ns, before, after_it) do
    steps = 2 * contact.bounces

    for step <- 1..steps//1 do
      drive = if rem(step, 2) == 1, do: before, else: after_it
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
       when normally in [:open, :closed] and to in [:ground, :supply] and is_integer(bounce_ns) and
              bounce_ns >= 0 and is_integer(bounces) and bounces > 0,
       do: opts

  defp check!(opts) do
    raise ArgumentError,
          "expected normally: :open or :closed, to: :ground or :supply, bounce_ns: and bounces: numbers, got: #{inspect(opts)}"
  end
end

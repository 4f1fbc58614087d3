defmodule BB.DiagnosticTest do
  use ExUnit.Case, async: true

  alias BB.{Diagnostic, Telemetry}

  doctest BB.Diagnostic

  # Other tests publish diagnostics too: these are told by their component.
  defp attach do
    {test, component} = {self(), [:"c#{System.unique_integer([:positive])}"]}

    handler = fn event, measurements, metadata, _config ->
      if metadata.component == component, do: send(test, {event, measurements, metadata})
    end

    :ok = Telemetry.attach(component, [:bb, :diagnostic], handler, nil)
    on_exit(fn -> Telemetry.detach(component) end)
    component
  end

  describe "new/1" do
    test "has no values and the present time by default" do
      before = DateTime.utc_now()
      diagnostic = Diagnostic.new(component: [:a, :b], level: :ok, message: "fine")
      assert %Diagnostic{component: [:a, :b], level: :ok, message: "fine"} = diagnostic
      assert diagnostic.values == %{}
      assert diagnostic.timestamp.time_zone == "Etc/UTC"
      assert DateTime.compare(diagnostic.timestamp, before) in [:gt, :eq]
      assert DateTime.compare(diagnostic.timestamp, DateTime.utc_now()) in [:lt, :eq]
    end

    test "takes values and a time" do
      time = ~U[2026-01-02 03:04:05Z]
      fields = [component: [:a], level: :stale, message: "m", values: %{x: 1}, timestamp: time]
      assert %Diagnostic{values: %{x: 1}, timestamp: ^time} = Diagnostic.new(fields)
    end

    test "needs a component, a level and a message" do
      fields = [component: [:a], level: :ok, message: "m"]

      for key <- Keyword.keys(fields),
          do: assert_raise(KeyError, fn -> Diagnostic.new(Keyword.delete(fields, key)) end)
    end

    test "refuses a level that does not exist" do
      assert_raise ArgumentError, ~r/expected a level of \[:ok, .*\], got: :fatal/, fn ->
        Diagnostic.new(component: [:a], level: :fatal, message: "m")
      end
    end
  end

  test "publish/1 emits the struct as metadata, without measurements" do
    component = attach()
    diagnostic = Diagnostic.new(component: component, level: :error, message: "m")
    assert Diagnostic.publish(diagnostic) == :ok
    assert_received {[:bb, :diagnostic], measurements, ^diagnostic}
    assert measurements == %{}

    assert Diagnostic.publish(component: component, level: :ok, message: "by fields") == :ok
    assert_received {[:bb, :diagnostic], _, %Diagnostic{level: :ok, message: "by fields"}}
  end

  for level <- [:ok, :warn, :error, :stale] do
    test "#{level}/2,3 publishes that level" do
      component = attach()
      assert apply(Diagnostic, unquote(level), [component, "m"]) == :ok
      assert_received {_, _, %Diagnostic{level: unquote(level), message: "m", values: %{}}}

      time = ~U[2026-01-02 03:04:05Z]
      opts = [values: %{volt: 7.4}, timestamp: time]
      assert apply(Diagnostic, unquote(level), [component, "m", opts]) == :ok
      assert_received {_, _, %Diagnostic{values: %{volt: 7.4}, timestamp: ^time}}
    end
  end
end
